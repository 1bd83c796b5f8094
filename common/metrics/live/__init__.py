"""Tracks scored against ground truth while both come in."""
