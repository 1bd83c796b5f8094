"""Rendering of candidates of people to train the body network; see README.md."""
