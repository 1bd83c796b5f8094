"""Points of a body against their ground truth, as in Figures 5.7 to 5.9 of the source.

An error is the distance in space from the estimate to the middle of the head, hand or foot, defined
by `references`, in frames in which it is visible. A second error is the distance to its
visible surface, on which points are marked by hand.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from msgspec.structs import replace

from benchmarks.lib.gait.recordings import (
    HANDS_AND_FEET,
    POINTS,
    Flags,
    GaitRecording,
    RecordedFrame,
)
from benchmarks.lib.table import markdown
from common.geometry.transforms import deproject, project
from people4d.messages import F64, Detection
from services.gait.cascade import Cascade, GaitEstimate, PersonObservation
from services.gait.config import CascadeConfig, DepthLayerConfig
from services.gait.points.keypoints import find_anchors

Feature = Literal["combined", "spin", "geodesic"]
FEATURES: tuple[Feature, ...] = ("spin", "geodesic", "combined")
CASES = {
    "gait_walk": "walking in curves",
    "gait_turn": "sudden turns",
    "gait_hand": "hand before the torso",
}
LIMBS = [POINTS.index(name) for name in HANDS_AND_FEET]
RIGHT_HAND = POINTS.index("right_hand")
KEYPOINT_M = 0.1  # standard deviation of a keypoint and its depth [m]
PUBLISHED_STATES = ("measured", "predicted")


@dataclass(frozen=True)
class PointVariant:
    """Variant of the method.

    Args:
        name: For tables.
        config: Configuration of the cascade.
        by_hand: Boxes are the true ones, and points are marked where they are first
            visible; else boxes are detected, and points start by themselves.
        keypoints: The detector's keypoints are given, too.
    """

    name: str
    config: CascadeConfig
    by_hand: bool = False
    keypoints: bool = True


def by_hand(feature: Feature) -> PointVariant:
    """Return the variant of one feature as published, with 100 particles."""
    config = DepthLayerConfig(feature=feature, particles=100, keypoints=False)
    return PointVariant(feature, CascadeConfig(depth=config), by_hand=True, keypoints=False)


SERVICE = PointVariant("with keypoints", CascadeConfig())
NO_KEYPOINTS = PointVariant("without keypoints", CascadeConfig(), keypoints=False)


@dataclass(frozen=True)
class PointResults:
    """Points of a recording, compared.

    Args:
        points_m: NxKx5x3, optical frame, NaN where lost.
        measured: NxKx5, False where predicted.
        covariances_m2: NxKx5x3x3, of the points.
        errors_m: NxKx5, NaN where the estimate is lost or the truth occluded.
        surface_errors_m: NxKx5, the same to the visible surface.
        visible: NxKx5, visibility in the ground truth.
    """

    points_m: F64
    measured: Flags
    covariances_m2: F64
    errors_m: F64
    surface_errors_m: F64
    visible: Flags


def track_points(
    recording: GaitRecording,
    variant: PointVariant,
    seed: int,
    frames: Iterable[RecordedFrame] | None = None,
) -> PointResults:
    """Track the points of all people in a recording.

    Args:
        recording: The recording.
        variant: Variant of the method.
        seed: Seed of the filters.
        frames: Frames of the recording, if in memory.
    """
    cascade = Cascade(replace(variant.config, seed=seed), recording.info)
    people = recording.truth.boxes_px.shape[1]
    marked = np.zeros((people, len(POINTS)), bool)
    points, measured, covariances = [], [], []
    for index, frame in enumerate(frames or recording.frames()):
        observations = observations_in(recording, index, variant)
        estimates = cascade.update_people(frame.stamp_ns, frame.rgb, frame.depth_mm, observations)
        if variant.by_hand:
            _mark(cascade, recording, index, frame, marked)
        rows = [_points(estimate) for estimate in estimates]
        points.append([row[0] for row in rows])
        measured.append([row[1] for row in rows])
        covariances.append([row[2] for row in rows])
    return compared(recording, np.array(points), np.array(measured), np.array(covariances))


def compared(
    recording: GaitRecording, points_m: F64, measured: Flags, covariances_m2: F64
) -> PointResults:
    """Return points compared with the ground truth."""
    visible = recording.truth.visible[: len(points_m)].astype(bool)
    surface, middle = (
        np.where(visible, np.linalg.norm(points_m - true_m[: len(points_m)], axis=-1), np.nan)
        for true_m in (recording.truth.points_m, recording.middles_m)
    )
    return PointResults(points_m, measured, covariances_m2, middle, surface, visible)


def keypoints_alone(recording: GaitRecording) -> PointResults:
    """Return the points at the depth of keypoints, unfiltered."""
    points = np.full(recording.truth.points_m.shape, np.nan)
    for index, frame in enumerate(recording.frames()):
        for k, detection in enumerate(recording.detections[index]):
            estimates = find_anchors(detection.keypoints if detection else None)
            for name, anchor in estimates.items():
                u, v = np.rint(anchor.pixel).astype(int)
                window = frame.depth_mm[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
                window = window[window > 0]
                if window.size:
                    depth_m = np.array([np.median(window) / 1000])
                    point_m = deproject(anchor.pixel[None], depth_m, recording.info)[0]
                    points[index, k, POINTS.index(name)] = point_m
    covariances = np.broadcast_to(KEYPOINT_M**2 * np.eye(3), (*points.shape, 3))
    return compared(recording, points, np.isfinite(points).all(axis=-1), covariances)


def observations_in(
    recording: GaitRecording, index: int, variant: PointVariant
) -> list[PersonObservation]:
    """Return the observations of a frame."""
    if variant.by_hand:
        boxes = recording.truth.boxes_px[index]
        depths_m = np.nanmean(recording.truth.points_m[0, :, :, 2], axis=1)
        return [
            PersonObservation(k, box, None, float(depths_m[k]) if index == 0 else None)
            for k, box in enumerate(boxes)
        ]
    return [_observation(k, one, variant) for k, one in enumerate(recording.detections[index])]


def _observation(k: int, detection: Detection | None, variant: PointVariant) -> PersonObservation:
    if detection is None:
        return PersonObservation(k)
    depth_m = None if detection.position_m is None else float(detection.position_m[2])
    keypoints = detection.keypoints if variant.keypoints else None
    return PersonObservation(k, detection.box_xyxy_px.astype(np.float64), keypoints, depth_m)


def _mark(
    cascade: Cascade, recording: GaitRecording, index: int, frame: RecordedFrame, marked: Flags
) -> None:
    """Mark the points that are visible for the first time."""
    for k, person in enumerate(recording.truth.points_m[index]):
        for p, point in enumerate(person):
            if not marked[k, p] and np.isfinite(point).all():
                pixel = project(point[None], recording.info)[0]
                marked[k, p] = cascade.mark_point(k, POINTS[p], pixel, frame.depth_mm)


def _points(estimate: GaitEstimate) -> tuple[F64, Flags, F64]:
    points, measured = np.full((len(POINTS), 3), np.nan), np.zeros(len(POINTS), bool)
    covariances = np.tile(np.eye(3), (len(POINTS), 1, 1))
    for row, name in enumerate(POINTS):
        point = estimate.points.get(name)
        if point is not None and point.state in PUBLISHED_STATES:
            points[row] = point.position_m
            covariances[row] = point.covariance[:3, :3]
            measured[row] = point.state == "measured"
    return points, measured, covariances


def surface_errors(runs: Iterable[PointResults], points: Sequence[int]) -> str:
    """Return median and 90th percentile of the errors to the visible surface, of all runs."""
    errors = np.concatenate([run.surface_errors_m[..., points].ravel() for run in runs])
    known = 100 * errors[np.isfinite(errors)]
    return f"{np.median(known):.1f}, {np.quantile(known, 0.9):.1f}"


def figures(runs: Sequence[PointResults], points: Sequence[int]) -> list[str]:
    """Return median, 90th percentile and published ratio of runs, with spreads over runs."""
    medians, ninths, ratios = [], [], []
    for run in runs:
        errors = run.errors_m[..., points]
        known = errors[np.isfinite(errors)]
        medians.append(100 * np.median(known) if len(known) else np.nan)
        ninths.append(100 * np.quantile(known, 0.9) if len(known) else np.nan)
        ratios.append(100 * len(known) / max(int(np.count_nonzero(run.visible[..., points])), 1))
    return [_spread(medians), _spread(ninths), f"{np.mean(ratios):.0f}"]


def _spread(values: Sequence[float]) -> str:
    return f"{np.mean(values):.1f} ({min(values):.1f} to {max(values):.1f})"


HEADER = ["median cm", "p90 cm", "published %"]


def table(runs: Mapping[tuple[str, str], Sequence[PointResults]], points: Sequence[int]) -> str:
    """Return errors of some points by case and variant."""
    rows = [
        [case, variant, *figures(found, points), surface_errors(found, points)]
        for (case, variant), found in runs.items()
    ]
    return markdown(["case", "tracked by", *HEADER, "to the surface: median, p90 cm"], rows)
