"""Upright boxes in space: overlap of annotated and tracked ones."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np

from common.metrics.record import GroundTruth, Hypotheses
from people4d.messages import F64

Box3d: TypeAlias = tuple[F64, float, F64]  # centre, yaw, and width, length and height


@dataclass(frozen=True)
class Overlap3d:
    """Similarity of people and tracks: intersection over union of their boxes with yaw.

    Positions are centres; a box without a known yaw is turned like the world.
    """

    sizes_m: Mapping[int, F64]  # [m] width (along x of the box), length and height of people
    track_size_m: tuple[float, float, float]  # [m] of all tracks

    def __call__(self, truth: GroundTruth, tracked: Hypotheses) -> F64:
        """Return the overlaps (NxM, 0 to 1) of N people and M tracks."""
        size_m = np.array(self.track_size_m)
        people = [
            (*box, self.sizes_m[int(one)])
            for one, box in zip(truth.ids, boxes_of(truth), strict=True)
        ]
        tracks = [(*box, size_m) for box in boxes_of(tracked)]
        overlaps = [[_overlap(a, b) for b in tracks] for a in people]
        return np.array(overlaps, np.float64).reshape(len(people), len(tracks))


def boxes_of(people: GroundTruth | Hypotheses) -> list[tuple[F64, float]]:
    """Return the centre (3) and the yaw, 0 if unknown, of each person."""
    n = len(people.ids)
    centres_m = np.zeros((0, 3)) if people.positions_m is None else people.positions_m
    yaws_rad = np.zeros(n) if people.yaws_rad is None else np.nan_to_num(people.yaws_rad)
    return list(zip(centres_m, yaws_rad.tolist(), strict=True))


def _overlap(a: Box3d, b: Box3d) -> float:
    """Return the overlap of two boxes: centre, yaw, and width, length and height."""
    high = min(a[0][2] + a[2][2] / 2, b[0][2] + b[2][2] / 2)
    low = max(a[0][2] - a[2][2] / 2, b[0][2] - b[2][2] / 2)
    common_m3 = max(float(high - low), 0.0) * _area(a, b)
    return common_m3 / (float(np.prod(a[2]) + np.prod(b[2])) - common_m3)


def _area(a: Box3d, b: Box3d) -> float:
    """Return the area of the intersection on the ground [m^2]."""
    origin = a[0]  # OpenCV computes in 32 bits
    _, corners = cv2.rotatedRectangleIntersection(_rectangle(a, origin), _rectangle(b, origin))
    if corners is None or len(corners) < 3:
        return 0.0
    return float(cv2.contourArea(cv2.convexHull(corners)))


def _rectangle(box: Box3d, origin: F64) -> tuple[list[float], list[float], float]:
    """Return the centre, sides and angle [deg] of a box on the ground."""
    centre, yaw_rad, size_m = box
    return (centre - origin)[:2].tolist(), size_m[:2].tolist(), float(np.degrees(yaw_rad))
