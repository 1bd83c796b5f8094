"""Training of the body network on rendered candidates; see README.md."""
