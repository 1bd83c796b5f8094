"""Data sets of other groups, in miniature."""
