"""Gestures of arms, from the joints of a skeleton in a frame with z up."""

import math
from collections.abc import Sequence

from people4d.messages import F32

HEAD = [0, 1, 2, 3, 4]  # face in COCO order
SHOULDERS, ELBOWS, WRISTS = (5, 6), (7, 8), (9, 10)  # left, right
ABOVE_M = 0.05  # minimum height of a raised wrist above the middle of the face [m]


def hand_raised(positions_m: F32, covariances_m2: F32, measured: Sequence[bool]) -> float:
    """Return the probability that a visible wrist is above the head, with its elbow; 0 if hidden.

    Args:
        positions_m: 17x3, joints in COCO order.
        covariances_m2: 17x3x3, covariances of the joints.
        measured: 17, True for visible joints.
    """
    head_m, head_m2 = float(positions_m[HEAD, 2].mean()), float(covariances_m2[HEAD, 2, 2].mean())
    best = 0.0
    for shoulder, elbow, wrist in zip(SHOULDERS, ELBOWS, WRISTS, strict=True):
        if measured[wrist] and positions_m[elbow, 2] > positions_m[shoulder, 2] - ABOVE_M:
            above_m = float(positions_m[wrist, 2]) - head_m - ABOVE_M
            sigma_m = math.sqrt(max(head_m2 + float(covariances_m2[wrist, 2, 2]), 1e-9))
            best = max(best, 0.5 * math.erfc(-above_m / sigma_m / math.sqrt(2)))
    return best
