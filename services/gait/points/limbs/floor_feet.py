"""Positions of feet beyond the range of depth, by the floor below their ankles.

A depth camera has a limited range. If there are no readings about the keypoint of an ankle, its ray
gives the position of a standing foot at the height of an ankle. A swinging ankle is higher, so its
foot appears farther away; its weight falls with the distance beyond the expected position.

Source: docs/method.md, section 19.
"""

from collections.abc import Mapping

import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F64, U16, CameraInfo
from services.gait.points.body import MeshObservation
from services.gait.points.keypoints import Anchor, kind_of
from services.gait.points.limbs.surface import FOOT_AHEAD_M, FOOT_BELOW_M, SurfacePosition
from services.gait.points.point_filter import GATE, PointFilter

ANKLE_M = 0.12  # Height of the keypoint of a standing ankle [m]
EMPTY_PX, EMPTY_MAX = 7, 0.2  # Radius about an ankle [px], and maximum share of readings there
CONFIDENCE_MIN = 0.3  # Minimum confidence of an ankle
ACROSS_M, ALONG_M = 0.06, 0.15  # Standard deviations across the ray and along it [m]
SWING = 0.5  # Standard deviation along the ray, per depth beyond the expected one
DEPTH_MAX_M = 8.0  # Maximum depth, since the length of a pixel on the floor grows with it [m]
PIXEL_SIGMA = 3.0  # Standard deviation of the ray [px]


def floor_positions(
    found: Mapping[str, Anchor],
    points: Mapping[str, PointFilter],
    observation: MeshObservation,
    heading: F64 | None,
    info: CameraInfo,
) -> Mapping[str, SurfacePosition]:
    """Return the positions of feet whose ankles have no depth; empty if no floor is known.

    `heading` is a unit vector in the optical frame.
    """
    floor, depth_mm = observation.floor, observation.depth_mm
    if floor is None or depth_mm is None:
        return {}
    positions = {}
    for name, anchor in found.items():
        if kind_of(name) != "foot" or anchor.joint is None or anchor.confidence < CONFIDENCE_MIN:
            continue
        if not _is_empty(depth_mm, anchor.joint):
            continue
        ray = deproject(anchor.joint, 1.0, info)[0]
        falling = -float(ray @ floor.up)
        if falling <= 0 or not 0 < (floor.camera_m - ANKLE_M) / falling < DEPTH_MAX_M:
            continue
        ahead_m = np.zeros(3) if heading is None else FOOT_AHEAD_M * heading
        ankle_m = (floor.camera_m - ANKLE_M) / falling * ray
        position_m = ankle_m - FOOT_BELOW_M * floor.up + ahead_m
        noise_m2 = _noise_m2(position_m, points[name], info)
        positions[name] = SurfacePosition(position_m, noise_m2, -1)
    return positions


def correct_by_floor(point: PointFilter, floor: SurfacePosition, dt_s: float) -> None:
    """Update a foot by the floor, within GATE; the foot stays predicted."""
    assert point.motion is not None
    if point.motion.distances2(floor.position_m[None], floor.noise_m2)[0] > GATE**2:
        point.mark_missed(dt_s)
        return
    point.unsupported_s = 0.0
    # Keeps the foot from being lost
    point.mark_doubtful(floor.position_m, floor.noise_m2, 0.0, likely=True)


def _noise_m2(position_m: F64, point: PointFilter, info: CameraInfo) -> F64:
    """Return the covariance of a position, 3x3."""
    along_m2 = ALONG_M**2
    if point.prior is not None:
        expected, _ = point.prior.on_ray(position_m, PIXEL_SIGMA, info)
        along_m2 += (SWING * max(float(position_m[2] - expected.mean_m[2]), 0.0)) ** 2
    ray = position_m / np.linalg.norm(position_m)
    return np.asarray(ACROSS_M**2 * np.eye(3) + along_m2 * np.outer(ray, ray))


def _is_empty(depth_mm: U16, pixel: F64) -> bool:
    """Check that there are hardly any readings about a pixel in the image."""
    height, width = depth_mm.shape
    column, row = (int(value) for value in np.round(pixel))
    if not (0 <= row < height and 0 <= column < width):
        return False
    rows = slice(max(row - EMPTY_PX, 0), row + EMPTY_PX + 1)
    near = depth_mm[rows, max(column - EMPTY_PX, 0) : column + EMPTY_PX + 1]
    return bool(np.count_nonzero(near) <= EMPTY_MAX * near.size)
