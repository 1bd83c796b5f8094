"""RGB-D sources behind one numpy interface."""
