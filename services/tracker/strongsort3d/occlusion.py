"""Occlusion policy: a person hidden by another one is not missed."""

import numpy as np

from people4d.messages import F64
from services.tracker.config import OcclusionConfig
from services.tracker.motion.track_record import BOOL
from services.tracker.motion.track_set import TrackSet
from services.tracker.strongsort3d.policies import AssociationResult, TrackPolicy
from services.tracker.strongsort3d.visibility import NEAR_M, intervals, overlap_ratios


class Occlusion(TrackPolicy):
    """Count frames in which a detected person hides an unmatched track as occluded."""

    def __init__(self, config: OcclusionConfig) -> None:
        self._config = config

    def after_update(self, tracks: TrackSet, result: AssociationResult) -> None:
        """Count the frame for tracks of its camera that are occluded in it."""
        observation, confirmed = result.frame.observation, tracks.confirmed
        if observation.map_from_camera is None or not confirmed:
            return
        detected = np.array([t.detection is not None for t in confirmed])
        positions_m = tracks.positions_m(confirmed)
        behind = occluded(positions_m, detected, observation.map_from_camera, self._config)
        for record, is_behind in zip(confirmed, behind, strict=True):
            if is_behind and record.camera == observation.camera:
                record.occluded += 1
                record.occluded_ns = observation.stamp_ns


def occluded(
    positions_m: F64, detected: BOOL, map_from_camera: F64, config: OcclusionConfig
) -> BOOL:
    """Return the people (N), not detected, whose interval is covered by detected ones, not farther.

    Positions (Nx3) are in the map, `map_from_camera` is from the optical frame.
    """
    people, depth = intervals(positions_m, map_from_camera, config.half_width_m)
    before = depth > NEAR_M
    hides = detected & before & (depth[None] < depth[:, None] + config.nearer_slack_m)
    ratio = np.where(hides, overlap_ratios(people, people), 0.0).max(axis=1, initial=0.0)
    result: BOOL = ~detected & before & (ratio >= config.covered_min)
    return result


def emergence_m(found_m: F64, map_from_camera: F64, config: OcclusionConfig) -> F64:
    """Return the distance (N) of each detected person from where another could have hidden them.

    It is that to the interval behind a detected person who is not farther away; infinity if there
    is none.
    """
    people, depth = intervals(found_m, map_from_camera, config.half_width_m)
    gap = np.maximum(
        people[:, None, 0] - people[None, :, 1], people[None, :, 0] - people[:, None, 1]
    )
    nearer = depth[None] < depth[:, None] + config.nearer_slack_m
    np.fill_diagonal(nearer, False)
    gap_m = np.where(nearer, np.maximum(gap, 0.0) * depth[:, None], np.inf)
    return np.asarray(gap_m.min(axis=1, initial=np.inf))
