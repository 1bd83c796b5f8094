"""Data sets of robots, in miniature."""
