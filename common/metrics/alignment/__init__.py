"""Alignment of ground truth to the clock and frame of the tracks."""
