"""The surface of a body in the depth image."""
