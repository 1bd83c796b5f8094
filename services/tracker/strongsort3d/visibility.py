"""Visibility policy: people occluded or outside the image (docs/method.md, section 13).

A person covers a horizontal interval of the image at focal length 1. An unmatched track is not
missed while its position is out of view or occluded; a position in view without a person ends it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.geometry.transforms import apply
from people4d.messages import F64
from services.tracker.interface import Observation
from services.tracker.motion.track_record import BOOL, TrackRecord
from services.tracker.motion.track_set import TrackSet
from services.tracker.strongsort3d.policies import (
    AssociationResult,
    FrameContext,
    VisibilityPolicy,
)

HALF_WIDTH_M = 0.25  # half of a person's width [m]
NEAR_M = 0.3  # minimum depth of a person in view [m]
COVERED_MIN = 0.4  # minimum covered share of the width of an occluded person
# Share of the width, relative to the last match, below which a position is out of view
IN_VIEW_MIN = 0.5
TURNED_MIN = 0.01  # minimum change of the visible share by a turn of the camera
EMPTY_S = 1.0  # maximum time in view without a match [s]
EMPTY_AT_EDGE_S = 0.2  # maximum time in view at the image border of a fixed camera [s]
HIDDEN_SIGMA_MAX_M = 1.0  # maximum standard deviation of the position of an unmatched track [m]
INTERVAL_MAX_NS = 200_000_000  # maximum counted interval between two frames [ns]
DEPTH_COVERED_MAX = 0.35  # maximum covered share of a box with reliable depth
DEPTH_SIGMA_M = 1.0  # standard deviation of an unreliable depth, along the ray [m]
SIDES = np.array([-1.0, 1.0])


@dataclass(slots=True)
class TrackView:
    """View of a track since its last match."""

    position_m: F64  # [m] 3, at the last match
    ratio: float  # visible share of the person's width at the last match
    at_edge: bool  # True if the left or right image border cut the box off at the last match
    frame_ns: int  # [ns] stamp of the last frame of the camera
    turned: bool = False  # True if the camera has turned since
    empty_ns: int = 0  # [ns] time in view without a match


class TrackVisibility(VisibilityPolicy):
    """Keeps occluded tracks, ends tracks at empty positions, widens gates of covered detections."""

    def __init__(self) -> None:
        self._views: dict[int, TrackView] = {}  # views by track

    def clear(self) -> None:
        """Delete all views."""
        self._views.clear()

    def gate(self, x: F64, P: F64, R: F64, d_cos: F64, frame: FrameContext) -> F64:
        """Return d_M^2 with a wide gate along the ray to covered detections.

        A wide gate requires an embedding. The update uses the measured noise; otherwise the track
        would lag behind the person.
        """
        gate, wider_m2 = super().gate(x, P, R, d_cos, frame), covered_m2(frame)
        if wider_m2 is None:
            return gate
        wide = super().gate(x, P, R + wider_m2, d_cos, frame)
        return np.where(np.isnan(d_cos), gate, wide)

    def after_update(self, tracks: TrackSet, result: AssociationResult) -> None:
        """Store the views of matched tracks, and end unmatched tracks at empty positions."""
        self._store(tracks, result)
        camera = result.frame.observation.camera
        missed = [t for t in tracks.records if t.missed and t.camera == camera]
        tracks.end(self._ended(tracks, missed, result.frame))
        alive = {t.id for t in tracks.records}
        self._views = {i: view for i, view in self._views.items() if i in alive}

    def _store(self, tracks: TrackSet, result: AssociationResult) -> None:
        records = [record for record, _ in result.matches]
        observation, cut_off = result.frame.observation, result.frame.cut_off
        positions_m = tracks.positions_m(records)
        ratios = visible_ratios(positions_m, observation)
        for (record, m), position_m, ratio in zip(result.matches, positions_m, ratios, strict=True):
            at_edge = m.index in cut_off or ratio < 1
            self._views[record.id] = TrackView(position_m, ratio, at_edge, observation.stamp_ns)

    def _ended(
        self, tracks: TrackSet, missed: Sequence[TrackRecord], frame: FrameContext
    ) -> set[int]:
        """Count hidden frames; return tracks at empty or too uncertain positions."""
        if not missed:
            return set()
        observation, ended = frame.observation, set[int]()
        predicted_m = tracks.positions_m(missed)
        predicted = visible_ratios(predicted_m, observation)
        views = [
            self._views.setdefault(t.id, TrackView(p_m, ratio, False, t.matched_ns))
            for t, p_m, ratio in zip(missed, predicted_m, predicted, strict=True)
        ]
        matched = visible_ratios(np.array([v.position_m for v in views]), observation)
        behind = occluded(predicted_m, frame.positions_m, observation.camera_from_map)
        rows = zip(missed, views, matched, predicted, behind, strict=True)
        for record, view, matched_ratio, predicted_ratio, is_behind in rows:
            least = IN_VIEW_MIN * view.ratio
            view.turned |= abs(matched_ratio - view.ratio) > TURNED_MIN
            leaves = not view.turned and (view.at_edge or predicted_ratio < least)
            if matched_ratio < least or (is_behind and not leaves):
                record.hidden += 1
            else:
                interval_ns = max(observation.stamp_ns - view.frame_ns, 0)
                view.empty_ns += min(interval_ns, INTERVAL_MAX_NS)
            view.frame_ns = observation.stamp_ns
            limit_s = EMPTY_AT_EDGE_S if leaves else EMPTY_S
            is_lost = np.linalg.eigvalsh(record.P[:2, :2])[-1] > HIDDEN_SIGMA_MAX_M**2
            if is_lost or view.empty_ns > limit_s * 1e9:
                ended.add(record.id)
        return ended


def covered_m2(frame: FrameContext) -> F64 | None:
    """Return covariances (Mx3x3) to add along rays to covered detections; None if there are none.

    The depth of a half occluded person is often the depth of the person in front.
    """
    pose = frame.observation.map_from_camera
    covered = common_ratios(frame.boxes).max(axis=1, initial=0.0) > DEPTH_COVERED_MAX
    if pose is None or not covered.any():
        return None
    rays = frame.positions_m - pose[:3, 3]
    rays /= np.maximum(np.linalg.norm(rays, axis=1), 1e-6)[:, None]
    variances_m2 = np.where(covered, DEPTH_SIGMA_M**2, 0.0)
    return np.asarray(variances_m2[:, None, None] * rays[:, :, None] * rays[:, None])


def visible_ratios(positions_m: F64, observation: Observation) -> list[float]:
    """Return the visible share (N, 0 to 1) of a person's width at each position (Nx3).

    It is 0 above and below the image, and 1 if pose or image border of the camera are unknown.
    """
    camera_from_map, edges = observation.camera_from_map, observation.edges
    if camera_from_map is None or edges is None:
        return [1.0] * len(positions_m)
    ratios = []
    # Scalars take a third of the time of arrays for a few people.
    for right_m, down_m, depth_m in apply(camera_from_map, positions_m).tolist():
        shown = depth_m > NEAR_M and edges.top * depth_m <= down_m <= edges.bottom * depth_m
        low, high = right_m - HALF_WIDTH_M, right_m + HALF_WIDTH_M
        inside = min(high, edges.right * depth_m) - max(low, edges.left * depth_m)
        ratios.append(max(inside, 0.0) / (high - low) if shown else 0.0)
    return ratios


def occluded(positions_m: F64, detected_m: F64, camera_from_map: F64 | None) -> BOOL:
    """Return a mask (N) of people whose interval a nearer detection covers.

    Positions (Nx3 and Mx3) are in the map, `camera_from_map` is to the optical frame.
    """
    if camera_from_map is None:
        return np.zeros(len(positions_m), np.bool_)
    people, depth_m = intervals(positions_m, camera_from_map)
    detected, detected_depth_m = intervals(detected_m, camera_from_map)
    hides = detected_depth_m[None] < depth_m[:, None]
    hides &= (depth_m > NEAR_M)[:, None] & (detected_depth_m > NEAR_M)
    ratio = np.where(hides, overlap_ratios(people, detected), 0.0).max(axis=1, initial=0.0)
    return np.asarray(ratio >= COVERED_MIN)


def intervals(positions_m: F64, camera_from_map: F64) -> tuple[F64, F64]:
    """Return intervals (Nx2: left, right) and depths (N, m) of people at positions (Nx3)."""
    points = apply(camera_from_map, positions_m)
    depth_m = points[:, 2]
    scale = 1.0 / np.where(depth_m > NEAR_M, depth_m, 1.0)
    centre, half = points[:, 0] * scale, HALF_WIDTH_M * scale
    return centre[:, None] + half[:, None] * SIDES, depth_m


def overlap_ratios(intervals: F64, others: F64) -> F64:
    """Return the share (NxM) of each interval (Nx2) that each other one covers; < 0 if apart."""
    high = np.minimum(intervals[:, None, 1], others[:, 1])
    common = high - np.maximum(intervals[:, None, 0], others[:, 0])
    ratio: F64 = common / (intervals[:, 1] - intervals[:, 0])[:, None]
    return ratio


def common_ratios(boxes: F64) -> F64:
    """Return the share (NxN) of each box (Nx4, xyxy, pixels) that each other one covers."""
    left, top, right, bottom = np.ascontiguousarray(boxes.T)
    width = np.minimum(right[:, None], right) - np.maximum(left[:, None], left)
    height = np.minimum(bottom[:, None], bottom) - np.maximum(top[:, None], top)
    common = np.maximum(width, 0.0) * np.maximum(height, 0.0)
    area = common.diagonal().copy()  # each box covers itself
    common.flat[:: len(boxes) + 1] = 0.0
    ratios: F64 = common / area[:, None]
    return ratios
