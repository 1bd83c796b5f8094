"""One method on one recording: tracks beside the ground truth, and their metrics."""
