"""Messages for Rerun and Foxglove, live and as files."""
