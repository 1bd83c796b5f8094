"""Motion models and filters of tracks."""
