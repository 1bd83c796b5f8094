"""Orientation of detected people."""
