"""Annotations of people in images."""

from evaluation.annotations.marks import HIDDEN, Mark, MarkView, read_frames

__all__ = ["HIDDEN", "Mark", "MarkView", "read_frames"]
