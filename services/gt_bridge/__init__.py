"""Ground truth in the frame of the tracks, and scores of the tracks."""
