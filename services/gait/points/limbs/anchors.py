"""Correction of keypoints of hands and feet that are on the wrong limb.

Source: docs/method.md, section 19.
"""

from collections.abc import Mapping

import numpy as np

from people4d.messages import CameraInfo
from services.gait.points.keypoints import (
    COUNTERPARTS,
    KEYPOINT_CONFIDENCE_MIN,
    PAIRS,
    Anchor,
    kind_of,
    pixels_of,
    sigma_px,
)
from services.gait.points.normal import Normal
from services.gait.points.point_filter import PointFilter

EXCHANGE_MIN = 6.0  # Minimum gain of exchanged keypoints [squared deviations]
COST_MAX = 25.0  # Maximum cost of one keypoint [squared deviations]
DOUBTFUL_COST_MAX = 9.0  # Maximum cost of a keypoint of low confidence [squared deviations]
SAME_M = 0.10  # Maximum distance between two points on one limb [m]


def keep_own_limbs(
    found: Mapping[str, Anchor],
    points: Mapping[str, PointFilter],
    dt_s: float,
    info: CameraInfo,
) -> dict[str, Anchor]:
    """Return anchors on their own limbs; exchange wrists that are on each other's limb.

    Anchors of low confidence must be near their point. `points` are predicted by `dt_s` seconds.
    """
    own = {
        name: anchor
        for name, anchor in found.items()
        if anchor.confidence > KEYPOINT_CONFIDENCE_MIN or _fits(name, anchor, points, dt_s, info)
    }
    for left, right in PAIRS:
        names = (left, right)
        if not all(name in own for name in names):
            continue
        expected = [points[name].expected_position(dt_s) for name in names]
        if expected[0] is None or expected[1] is None:
            continue
        costs = np.array(
            [[_cost(one, own[name], info) for name in names] for one in expected if one]
        )
        if kind_of(left) == "hand" and (
            costs[0, 1] + costs[1, 0] + EXCHANGE_MIN < costs[0, 0] + costs[1, 1]
        ):
            own[left], own[right] = own[right], own[left]
            costs = costs[:, ::-1]
        depth_m = float(expected[0].mean_m[2])
        apart_px = float(np.linalg.norm(own[left].pixel - own[right].pixel))
        if apart_px < pixels_of(SAME_M, depth_m, info):
            confident = [own[name].confidence > KEYPOINT_CONFIDENCE_MIN for name in names]
            fits = costs[0, 0] <= costs[1, 1] if confident[0] == confident[1] else confident[0]
            own.pop(right if fits else left)
    return own


def _fits(
    name: str,
    anchor: Anchor,
    points: Mapping[str, PointFilter],
    dt_s: float,
    info: CameraInfo,
) -> bool:
    """Check that an anchor is at the expected position of its point, not of the other limb."""
    expected, other = (points[one].expected_position(dt_s) for one in (name, COUNTERPARTS[name]))
    if expected is None:
        return False
    cost = _cost(expected, anchor, info)
    at_other = other is not None and _cost(other, anchor, info) < cost
    return cost <= DOUBTFUL_COST_MAX and not at_other


def _cost(expected: Normal, anchor: Anchor, info: CameraInfo) -> float:
    noise_px = sigma_px(anchor, float(expected.mean_m[2]), info)
    return min(expected.pixel_distance2(anchor.pixel, noise_px, info), COST_MAX)
