"""Ground truth: motion capture, people in each frame, markers on the body."""
