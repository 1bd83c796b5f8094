"""Whether the camera looks where somebody was seen last, or has turned away from there.

A camera that stands looks at the same place for ever: whoever is not seen there any more went away.
A camera that turns leaves people behind who stay where they are: nobody looked, so nobody was
missed.
"""

from collections.abc import Sequence

import numpy as np

from people4d.messages import F64
from services.tracker.identity.config import OcclusionConfig
from services.tracker.interface import Observation
from services.tracker.motion.population import Target
from services.tracker.strongsort3d.occlusion import NEAR_M, columns, shares


def shown(places_m: F64, observation: Observation, half_width_m: float) -> F64 | None:
    """Return which part (N, 0 to 1) of a person's width the image has room for at each place.

    Args:
        places_m: Nx3, frame: the one that tracks are in.
        observation: Whose camera.
        half_width_m: Half of a person's width.

    Returns:
        None if it is not known where the camera stands, or how wide its view is.
    """
    if observation.map_from_camera is None or observation.edges is None:
        return None
    strips, depth_m = columns(places_m, observation.map_from_camera, half_width_m)
    part = np.clip(shares(strips, np.array([observation.edges]))[:, 0], 0.0, 1.0)
    return np.where(depth_m > NEAR_M, part, 0.0)


def mark_unwatched(
    targets: Sequence[Target], observation: Observation, elapsed_ns: int, config: OcclusionConfig
) -> None:
    """Count the frame, for whom the camera has turned away from, as one in which nobody looked.

    Args:
        targets: Predicted to the frame.
        observation: The frame.
        elapsed_ns: Since the frame before.
        config: Width of a person, and how much less must be in view.
    """
    gone = [t for t in targets if t.watched_m is not None and t.camera == observation.camera]
    places_m = np.array([t.watched_m for t in gone]).reshape(-1, 3)
    parts = shown(places_m, observation, config.half_width_m)
    if parts is None:
        return
    for target, part in zip(gone, parts.tolist(), strict=True):
        if part < config.watched_min * target.shown:
            target.unwatched += 1
            target.unwatched_ns += elapsed_ns


def mark_watched(
    targets: Sequence[Target], observation: Observation, config: OcclusionConfig
) -> None:
    """Note where people are who are seen, and how much of that place is in view."""
    places_m = np.array([t.x[:3] for t in targets]).reshape(-1, 3)
    parts = shown(places_m, observation, config.half_width_m)
    if parts is None:
        return
    for target, place_m, part in zip(targets, places_m, parts.tolist(), strict=True):
        target.watched_m, target.shown = place_m, part
