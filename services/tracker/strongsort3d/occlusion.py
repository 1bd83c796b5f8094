"""Policies for people who are out of sight: hidden by another one, or beside the image."""

import numpy as np

from common.geometry.transforms import apply
from people4d.messages import F64
from services.tracker.interface import Observation
from services.tracker.motion.track_record import BOOL
from services.tracker.motion.track_set import TrackSet
from services.tracker.strongsort3d.config import OcclusionConfig
from services.tracker.strongsort3d.policies import AssociationResult, TrackPolicy
from services.tracker.strongsort3d.visibility import NEAR_M, intervals, overlap_ratios

TURNED_MIN = 0.01  # of a person's width: a camera that shows so much more or less of it moves


class Occlusion(TrackPolicy):
    """Count frames in which a detected person hides an unmatched track as occluded."""

    def __init__(self, config: OcclusionConfig) -> None:
        self._config = config

    def after_update(self, tracks: TrackSet, result: AssociationResult) -> None:
        """Count the frame for tracks of its camera that are occluded in it."""
        frame = result.frame
        camera, pose = frame.observation.camera, frame.observation.camera_from_map
        lost = [t for t in tracks.records if t.detection is None and t.camera == camera]
        if pose is None or not lost or not frame.detections:
            return
        behind = occluded(tracks.positions_m(lost), frame.positions_m, pose, self._config)
        for record, is_behind in zip(lost, behind, strict=True):
            record.occluded += bool(is_behind)


def occluded(
    positions_m: F64, detected_m: F64, camera_from_map: F64, config: OcclusionConfig
) -> BOOL:
    """Return the people (N) whose interval is covered by that of a detected one, not farther.

    Positions (Nx3 and Mx3) are in the map, `camera_from_map` is to the optical frame.
    """
    people, depth = intervals(positions_m, camera_from_map, config.half_width_m)
    detected, detected_depth = intervals(detected_m, camera_from_map, config.half_width_m)
    hides = detected_depth[None] < depth[:, None]
    hides &= (depth > NEAR_M)[:, None] & (detected_depth > NEAR_M)
    ratio = np.where(hides, overlap_ratios(people, detected), 0.0).max(axis=1, initial=0.0)
    return np.asarray(ratio >= config.covered_min)


class FieldOfView(TrackPolicy):
    """Count frames that do not show the position of a track's last match as out of view.

    A fixed camera keeps its field of view: a person who is not detected there any more has left. A
    camera that turns leaves people behind who stay where they are. A track that is predicted out of
    an image which still shows its last match is leaving.
    """

    def __init__(self, config: OcclusionConfig) -> None:
        self._config = config

    def after_prediction(self, tracks: TrackSet, observation: Observation) -> None:
        """Count the frame for tracks that the camera turned away from, and mark leaving ones."""
        known = [
            (t, t.matched_position_m)
            for t in tracks.records
            if t.matched_position_m is not None and t.camera == observation.camera
        ]
        if not known:
            return
        matched_m = np.array([position_m for _, position_m in known])
        predicted_m = tracks.positions_m([record for record, _ in known])
        positions_m = np.concatenate([matched_m, predicted_m])
        ratios = visible_ratios(positions_m, observation, self._config.half_width_m)
        if ratios is None:
            return
        halves = ratios[: len(known)], ratios[len(known) :]
        for (record, _), matched, predicted in zip(known, *halves, strict=True):
            least = self._config.in_view_min * record.visible_ratio
            if matched < least:
                record.out_of_view += 1
                record.out_of_view_ns += tracks.elapsed_ns
            record.turned |= abs(matched - record.visible_ratio) > TURNED_MIN
            record.leaving = predicted < least <= matched

    def after_update(self, tracks: TrackSet, result: AssociationResult) -> None:
        """Store the positions of matched tracks, and how much of each is in view."""
        records = [record for record, _ in result.matches]
        if not records:
            return
        positions_m = tracks.positions_m(records)
        ratios = visible_ratios(positions_m, result.frame.observation, self._config.half_width_m)
        if ratios is None:
            return
        for record, position_m, ratio in zip(records, positions_m, ratios, strict=True):
            record.matched_position_m, record.visible_ratio = position_m, ratio


def visible_ratios(
    positions_m: F64, observation: Observation, half_width_m: float
) -> list[float] | None:
    """Return the part (N, 0 to 1) of a person's width that is in the image at each position (Nx3).

    It is 0 above and below the image. None if the camera's pose or the edges of its image are
    unknown.
    """
    camera_from_map, edges = observation.camera_from_map, observation.edges
    if camera_from_map is None or edges is None:
        return None
    ratios = []
    # For the few people of a frame numbers take a third of the time of arrays.
    for right_m, down_m, depth_m in apply(camera_from_map, positions_m).tolist():
        shown = depth_m > NEAR_M and edges.top * depth_m <= down_m <= edges.bottom * depth_m
        low, high = right_m - half_width_m, right_m + half_width_m
        inside = min(high, edges.right * depth_m) - max(low, edges.left * depth_m)
        ratios.append(max(inside, 0.0) / (high - low) if shown else 0.0)
    return ratios
