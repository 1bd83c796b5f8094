"""Ground truth: motion capture, people in each frame, visible points of the body."""
