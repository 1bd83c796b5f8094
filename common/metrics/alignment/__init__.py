"""Ground truth brought to the clock and the frame of the tracks."""
