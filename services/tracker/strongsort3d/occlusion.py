"""Policies for people who are out of sight: hidden by another one, or beside the image."""

import numpy as np

from people4d.messages import F64
from services.tracker.config import OcclusionConfig
from services.tracker.interface import Observation
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


class FieldOfView(TrackPolicy):
    """Count frames that do not show the position of a track's last match as out of view.

    A fixed camera keeps its field of view: a person who is not detected there any more has left. A
    camera that turns leaves people behind who stay where they are.
    """

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
