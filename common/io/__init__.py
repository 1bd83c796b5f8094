"""Recordings, bags, images and other files."""
