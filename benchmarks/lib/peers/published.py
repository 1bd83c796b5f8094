"""Configurations of the tracker with the published constants."""

from typing import Any

from msgspec.structs import replace

from evaluation.methods import read_method
from services.tracker.config import TrackerConfig


def published_tracker(tracker: str, **constants: Any) -> TrackerConfig:
    """Return a tracker with the constants of [PIC4SeR].

    Args:
        tracker: Name of the tracker.
        constants: Of StrongSORT-3D, which differ.
    """
    strong = read_method("seg-strongsort").tracker.strongsort3d
    return TrackerConfig(tracker=tracker, yaw="velocity", strongsort3d=replace(strong, **constants))
