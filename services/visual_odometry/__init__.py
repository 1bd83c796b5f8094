"""Motion of a base from the images of its camera."""
