"""The report of an evaluation: tables, figures, images, CSV files and one HTML page."""
