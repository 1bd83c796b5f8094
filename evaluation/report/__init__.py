"""The report of an evaluation: tables, figures, filmstrips, CSV files and one HTML page."""
