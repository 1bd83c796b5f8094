"""Motion-capture truth to the same shape as tracks."""
