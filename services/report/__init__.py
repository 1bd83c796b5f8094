"""Report of a run: contact sheet, videos and summary."""
