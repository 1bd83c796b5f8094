"""Methods judged against motion capture: offline, frame by frame, the same figures every time."""
