"""Cameras of a tracker: clocks, order of frames, poses, and errors of both."""
