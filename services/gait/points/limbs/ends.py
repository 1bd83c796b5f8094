"""Positions of hands and feet at the ends of their limbs, without keypoints.

A limb ends in fingers or toes, or in the heel if the foot points away from the camera.
The middle of the hand or foot follows from the direction of forearm or shank: linear regression on
the middles of three slices of the limb, across its length.

Source: docs/method.md, section 19.
"""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from people4d.messages import F64
from services.gait.points.body import Extremity, MeasuredBody
from services.gait.points.keypoints import kind_of
from services.gait.points.limbs.surface import SurfacePosition
from services.gait.surface.segmentation import I64

SLICES_M = ((0.0, 0.08), (0.16, 0.24), (0.32, 0.45))  # Slices from the end along the body [m]
SLICE_VERTICES_MIN = 3  # Minimum number of vertices of a slice
NOISE_M, DEPTH_NOISE_M = 0.03, 0.02  # Noise of the position, and addition along the ray [m]
# Coefficients of the offset of the middle from the extremity ahead, aside (to the side of the limb)
# and up, by the offsets of each slice, the cosine of heading and ray, and 1. Fitted to the tuning
# split of two simulators, see benchmarks/gait_bodies.md and benchmarks/gait.md.
OFFSETS: Mapping[str, F64] = MappingProxyType(
    {
        "foot": np.array(
            [
                (0.10, -0.02, 0.20),
                (-0.07, 0.20, -0.19),
                (-0.26, -0.11, 0.15),
                (0.32, 0.11, -0.49),
                (0.05, 0.52, 0.0),
                (0.05, -0.19, 0.27),
                (0.24, -0.02, 0.39),
                (-0.06, 0.10, -0.05),
                (0.07, -0.06, -0.19),
                (0.03, 0.0, 0.0),
                (0.02, 0.02, 0.01),
            ]
        ),
        "hand": np.array(
            [
                (0.38, -0.04, -0.08),
                (-0.09, 0.38, -0.19),
                (0.03, 0.07, 0.41),
                (0.35, -0.01, -0.04),
                (0.02, 0.29, 0.04),
                (0.10, -0.16, -0.21),
                (-0.03, 0.07, -0.09),
                (-0.06, 0.05, 0.17),
                (-0.02, -0.04, 0.11),
                (0.0, 0.0, 0.0),
                (0.01, 0.06, -0.01),
            ]
        ),
    }
)


def end_position(
    name: str,
    extremity: Extremity | None,
    body: MeasuredBody,
    heading: F64 | None,
    up: F64,
) -> SurfacePosition | None:
    """Return the position of a hand or foot by the end of its limb; None if no end is found.

    `heading` and `up` are unit vectors in the optical frame.
    """
    if extremity is None or heading is None:
        return None
    side = 1.0 if name.startswith("left") else -1.0
    axes = np.stack([heading, side * np.cross(up, heading), up])
    limb = np.flatnonzero(body.extrema.basin == extremity.basin)
    along_m = body.tip_distance_m[limb]
    known = [
        axes @ _middle(body, limb[(along_m >= low) & (along_m < high)], extremity)
        for low, high in SLICES_M
    ]
    ray = extremity.position_m / np.linalg.norm(extremity.position_m)
    inputs = np.concatenate([*known, [float(heading @ ray), 1.0]])
    position_m = extremity.position_m + (inputs @ OFFSETS[kind_of(name)]) @ axes
    noise_m2 = NOISE_M**2 * np.eye(3) + DEPTH_NOISE_M**2 * np.outer(ray, ray)
    return SurfacePosition(position_m, noise_m2, body.mesh.nearest(extremity.position_m))


def _middle(body: MeasuredBody, vertices: I64, extremity: Extremity) -> F64:
    """Return the middle of a slice from the extremity, 3; 0 if it is not visible."""
    if len(vertices) < SLICE_VERTICES_MIN:
        return np.zeros(3)
    return np.asarray(np.median(body.mesh.points_m[vertices], axis=0) - extremity.position_m)
