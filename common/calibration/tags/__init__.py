"""AprilTags at measured positions in the map, see docs/method.md."""
