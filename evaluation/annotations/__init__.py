"""Annotations of people in images of a recording: page, file, truth, agreement."""
