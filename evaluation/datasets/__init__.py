"""Data sets of other groups: one adapter a file, see `dataset.Dataset`."""
