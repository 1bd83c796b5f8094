"""Trackers of others, and published configurations, on the same input."""
