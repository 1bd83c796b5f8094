"""Field of view policy: a camera that turned away from a person has not missed them.

A fixed camera keeps its field of view: a person who is not detected there any more has left. A
camera that turns leaves people behind who stay where they are.
"""

import numpy as np

from people4d.messages import F64
from services.tracker.config import OcclusionConfig
from services.tracker.interface import Observation
from services.tracker.motion.track_set import TrackSet
from services.tracker.strongsort3d.policies import AssociationResult, TrackPolicy
from services.tracker.strongsort3d.visibility import NEAR_M, intervals, overlap_ratios


class FieldOfView(TrackPolicy):
    """Count frames that do not show the position of a track's last match as out of view."""

    def __init__(self, config: OcclusionConfig) -> None:
        self._config = config

    def after_prediction(self, tracks: TrackSet, observation: Observation) -> None:
        """Count the frame for tracks that the camera has turned away from."""
        known = [
            (t, t.matched_position_m)
            for t in tracks.records
            if t.matched_position_m is not None and t.camera == observation.camera
        ]
        positions_m = np.array([position_m for _, position_m in known]).reshape(-1, 3)
        ratios = visible_ratios(positions_m, observation, self._config.half_width_m)
        if ratios is None:
            return
        for (record, _), ratio in zip(known, ratios.tolist(), strict=True):
            if ratio < self._config.in_view_min * record.visible_ratio:
                record.out_of_view += 1
                record.out_of_view_ns += tracks.elapsed_ns

    def after_update(self, tracks: TrackSet, result: AssociationResult) -> None:
        """Store the positions of matched tracks, and how much of each is in view."""
        records = [record for record, _ in result.matches]
        positions_m = tracks.positions_m(records)
        ratios = visible_ratios(positions_m, result.frame.observation, self._config.half_width_m)
        if ratios is None:
            return
        for record, position_m, ratio in zip(records, positions_m, ratios.tolist(), strict=True):
            record.matched_position_m, record.visible_ratio = position_m, ratio


def visible_ratios(positions_m: F64, observation: Observation, half_width_m: float) -> F64 | None:
    """Return the part (N, 0 to 1) of a person's width that is in the image at each position (Nx3).

    None if the camera's pose or the edges of its image are unknown.
    """
    if observation.map_from_camera is None or observation.edges is None:
        return None
    people, depth_m = intervals(positions_m, observation.map_from_camera, half_width_m)
    image = np.array([observation.edges])
    ratio = np.clip(overlap_ratios(people, image)[:, 0], 0.0, 1.0)
    return np.where(depth_m > NEAR_M, ratio, 0.0)
