"""Points of a body in depth against their truth, as in the Figures 5.7 to 5.9 of the thesis.

An error is the distance in space from what is told to what the camera sees at the middle of the
head, hand or foot, in frames in which it sees that.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from msgspec.structs import replace

from benchmarks.lib.gait_takes import HANDS_AND_FEET, POINTS, Flags, Frame, Take
from benchmarks.lib.table import markdown
from common.geometry.transforms import apply, deproject, project
from people4d.messages import F64, Detection
from services.gait.cascade import Cascade, GaitEstimate, Seen
from services.gait.cascade_config import CascadeConfig
from services.gait.points.config import DepthLayerConfig
from services.gait.points.points import anchors

Feature = Literal["combined", "spin", "geodesic"]
FEATURES: tuple[Feature, ...] = ("spin", "geodesic", "combined")
CASES = {
    "gait_walk": "walking in curves",
    "gait_turn": "sudden turns",
    "gait_hand": "hand before the trunk",
}
LIMBS = [POINTS.index(name) for name in HANDS_AND_FEET]
RIGHT_HAND = POINTS.index("right_hand")
TOLD = ("measured", "predicted")
AIM_CM, AIM_P90_CM = 5.0, 12.0  # of hands and feet


@dataclass(frozen=True)
class Way:
    """How people are followed.

    Args:
        name: For tables.
        config: Of the cascade.
        by_hand: Boxes are the true ones, and points are marked where they are first seen; else
            the detector gives boxes, and the points find themselves.
        keypoints: The detector's keypoints are given, too.
    """

    name: str
    config: CascadeConfig
    by_hand: bool = False
    keypoints: bool = True


def by_hand(feature: Feature) -> Way:
    """Return a feature started as in the thesis, with its 100 particles."""
    config = DepthLayerConfig(feature=feature, particles=100, keypoints=False)
    return Way(feature, CascadeConfig(depth=config), by_hand=True, keypoints=False)


SERVICE = Way("with keypoints", CascadeConfig())
NO_KEYPOINTS = Way("without keypoints", CascadeConfig(), keypoints=False)


@dataclass(frozen=True)
class Followed:
    """What was told of a film.

    Args:
        points_m: NxKx5x3, optical frame, NaN where nothing was told.
        measured: NxKx5, told from what was seen, not predicted.
        errors_m: NxKx5, NaN where nothing was told or the truth is not seen.
        visible: NxKx5, of the truth.
    """

    points_m: F64
    measured: Flags
    errors_m: F64
    visible: Flags


def follow(take: Take, way: Way, seed: int, frames: Iterable[Frame] | None = None) -> Followed:
    """Follow the points of everyone in a film.

    Args:
        take: The film.
        way: How.
        seed: Of the filters.
        frames: Of the film, if they are at hand.
    """
    cascade = Cascade(_seeded(way.config, seed), take.info)
    people = take.truth.boxes_px.shape[1]
    marked = np.zeros((people, len(POINTS)), bool)
    points, measured = [], []
    for index, frame in enumerate(frames or take.frames()):
        seen = seen_in(take, index, way)
        told = cascade.update(frame.stamp_ns, frame.rgb, frame.depth_mm, seen)
        if way.by_hand:
            _mark(cascade, take, index, frame, marked)
        rows = [_told(estimate) for estimate in told]
        points.append([row[0] for row in rows])
        measured.append([row[1] for row in rows])
    return judged(take, np.array(points), np.array(measured))


def judged(take: Take, points_m: F64, measured: Flags) -> Followed:
    """Return what was told, compared with the truth."""
    errors = np.linalg.norm(points_m - take.truth.points_m[: len(points_m)], axis=-1)
    visible = take.truth.visible[: len(points_m)].astype(bool)
    return Followed(points_m, measured, np.where(visible, errors, np.nan), visible)


def keypoints_alone(take: Take) -> Followed:
    """Return what keypoints and the depth there tell without any filter."""
    config = DepthLayerConfig()
    points = np.full(take.truth.points_m.shape, np.nan)
    for index, frame in enumerate(take.frames()):
        for k, detection in enumerate(take.sightings[index]):
            told = anchors(detection.keypoints if detection else None, config)
            for name, anchor in told.items():
                u, v = np.rint(anchor.pixel).astype(int)
                window = frame.depth_mm[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
                window = window[window > 0]
                if window.size:
                    depth_m = np.array([np.median(window) / 1000])
                    place = deproject(anchor.pixel[None], depth_m, take.info)[0]
                    points[index, k, POINTS.index(name)] = place
    return judged(take, points, np.isfinite(points).all(axis=-1))


def seen_in(take: Take, index: int, way: Way) -> list[Seen]:
    """Return what the cascade is given of each person in a frame."""
    if way.by_hand:
        boxes = take.truth.boxes_px[index]
        depths_m = np.nanmean(take.truth.points_m[0, :, :, 2], axis=1)
        return [
            Seen(k, box, None, float(depths_m[k]) if index == 0 else None)
            for k, box in enumerate(boxes)
        ]
    return [_seen(k, one, way) for k, one in enumerate(take.sightings[index])]


def _seen(k: int, detection: Detection | None, way: Way) -> Seen:
    if detection is None:
        return Seen(k)
    depth_m = None if detection.position_m is None else float(detection.position_m[2])
    keypoints = detection.keypoints if way.keypoints else None
    return Seen(k, detection.box_xyxy_px.astype(np.float64), keypoints, depth_m)


def _mark(cascade: Cascade, take: Take, index: int, frame: Frame, marked: Flags) -> None:
    """Mark the points that are seen for the first time, as the paper's authors did by hand."""
    for k, person in enumerate(take.truth.points_m[index]):
        for p, point in enumerate(person):
            if not marked[k, p] and np.isfinite(point).all():
                pixel = project(point[None], take.info)[0]
                marked[k, p] = cascade.mark(k, POINTS[p], pixel, frame.depth_mm)


def _told(estimate: GaitEstimate) -> tuple[F64, Flags]:
    points, measured = np.full((len(POINTS), 3), np.nan), np.zeros(len(POINTS), bool)
    for row, name in enumerate(POINTS):
        point = estimate.points.get(name)
        if point is not None and point.state in TOLD:
            points[row] = point.position_m
            measured[row] = point.state == "measured"
    return points, measured


def _seeded(config: CascadeConfig, seed: int) -> CascadeConfig:
    return replace(config, seed=seed)


def figures(runs: Sequence[Followed], points: Sequence[int]) -> list[str]:
    """Return median, 90th percentile and told share of runs, each with its spread over runs."""
    medians, ninths, shares = [], [], []
    for run in runs:
        errors = run.errors_m[..., points]
        known = errors[np.isfinite(errors)]
        medians.append(100 * np.median(known) if len(known) else np.nan)
        ninths.append(100 * np.quantile(known, 0.9) if len(known) else np.nan)
        shares.append(100 * len(known) / max(int(np.count_nonzero(run.visible[..., points])), 1))
    return [_spread(medians), _spread(ninths), f"{np.mean(shares):.0f}"]


def _spread(values: Sequence[float]) -> str:
    return f"{np.mean(values):.1f} ({min(values):.1f} to {max(values):.1f})"


HEADER = ["median cm", "p90 cm", "told %"]


def table(runs: Mapping[tuple[str, str], Sequence[Followed]], points: Sequence[int]) -> str:
    """Return errors of some points by case and way."""
    rows = [[case, way, *figures(found, points)] for (case, way), found in runs.items()]
    return markdown(["case", "followed by", *HEADER], rows)


def by_point(runs: Mapping[str, Sequence[Followed]]) -> str:
    """Return errors by case and point."""
    rows = [
        [case, name.replace("_", " "), *figures(found, [row])]
        for case, found in runs.items()
        for row, name in enumerate(POINTS)
    ]
    return markdown(["case", "point", *HEADER], rows)


def in_map(take: Take, points_m: F64) -> F64:
    """Return points of the optical frame in the map, same shape; the camera stands still."""
    return apply(take.map_from_optical, points_m.reshape(-1, 3)).reshape(points_m.shape)
