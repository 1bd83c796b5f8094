"""Trackers of other packages on the same input."""
