"""Upright boxes in space: overlap of annotated and tracked ones."""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from common.metrics.record import GroundTruth, Hypotheses, Id
from people4d.messages import F64


@dataclass(frozen=True)
class Overlap3d:
    """Similarity of people and tracks: intersection over union of their boxes with yaw.

    Positions are centres; a box without a known yaw is turned like the world.
    """

    sizes_m: Mapping[Id, F64]  # [m] width (along x of the box), length and height of people
    track_size_m: tuple[float, float, float]  # [m] of all tracks

    def __call__(self, truth: GroundTruth, tracked: Hypotheses) -> F64:
        """Return the overlaps (NxM, 0 to 1) of N people and M tracks."""
        size_m = np.array(self.track_size_m)
        people = [
            (*box, self.sizes_m[one]) for one, box in zip(truth.ids, boxes_of(truth), strict=True)
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


def _overlap(a: tuple[F64, float, F64], b: tuple[F64, float, F64]) -> float:
    """Return the overlap of two boxes: centre, yaw, and width, length and height."""
    high = min(a[0][2] + a[2][2] / 2, b[0][2] + b[2][2] / 2)
    low = max(a[0][2] - a[2][2] / 2, b[0][2] - b[2][2] / 2)
    common_m3 = max(high - low, 0.0) * _area(a, b)
    both_m3 = float(np.prod(a[2]) + np.prod(b[2]))
    return common_m3 / (both_m3 - common_m3)


def _area(a: tuple[F64, float, F64], b: tuple[F64, float, F64]) -> float:
    """Return the area of the intersection on the ground [m^2]."""
    centre = a[0][:2]  # near the origin: OpenCV computes in 32 bits
    rectangles = [
        ((one[0][:2] - centre).tolist(), one[2][:2].tolist(), float(np.degrees(one[1])))
        for one in (a, b)
    ]
    _, corners = cv2.rotatedRectangleIntersection(*rectangles)
    if corners is None or len(corners) < 3:
        return 0.0
    return float(cv2.contourArea(cv2.convexHull(corners)))
