"""Rendering of people for networks that are trained on them; see README.md."""
