"""Similarity of a person and a track, 0 to 1; matches have at least 0.5."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from common.geometry.boxes import iou_xyxy
from common.metrics.record import GroundTruth, Hypotheses
from people4d.messages import F64

Similarity: TypeAlias = Callable[[GroundTruth, Hypotheses], F64]


def box_overlap(truth: GroundTruth, tracked: Hypotheses) -> F64:
    """Return the intersection over union (NxM, 0 to 1) of the boxes of N people and M tracks.

    ValueError if there are people without boxes.
    """
    boxes = _column("boxes_xyxy_px", truth.boxes_xyxy_px, len(truth.ids), 4)
    return iou_xyxy(boxes, _column("boxes_xyxy_px", tracked.boxes_xyxy_px, len(tracked.ids), 4))


@dataclass(frozen=True)
class GroundDistance:
    """Similarity by the distance on the ground plane: 1 - d / (2 max_m), at least 0.

    At the maximum distance max_m of a match the similarity is 0.5; HOTA's thresholds 0.05 to 0.95
    are 1.9 to 0.1 times max_m.
    """

    max_m: float = 1.0  # [m] maximum distance of a match, usually 0.5 to 1

    def __post_init__(self) -> None:
        """Check the distance."""
        if not self.max_m > 0:
            raise ValueError(f"max_m: expected > 0, got {self.max_m}")

    def __call__(self, truth: GroundTruth, tracked: Hypotheses) -> F64:
        """Return the similarity (NxM, 0 to 1) of the positions of N people and M tracks.

        ValueError if there are people without positions.
        """
        a = _column("positions_m", truth.positions_m, len(truth.ids), 3)[:, None, :2]
        b = _column("positions_m", tracked.positions_m, len(tracked.ids), 3)[None, :, :2]
        distance_m = np.linalg.norm(a - b, axis=-1)
        alike: F64 = np.maximum(0.0, 1.0 - distance_m / (2.0 * self.max_m))
        return alike


def _column(name: str, values: F64 | None, n: int, width: int) -> F64:
    if values is None and n:
        raise ValueError(f"{name}: expected one for each of {n} people, got none")
    return np.zeros((0, width)) if values is None else values
