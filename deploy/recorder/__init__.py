"""Recorders: one file, the newest megabytes in parts, and files around events."""
