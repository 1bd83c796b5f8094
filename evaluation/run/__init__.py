"""One method on one recording: tracks, ground truth and metrics."""
