"""Rendering of people to train networks; see README.md."""
