"""Rotation of a camera and its effect on tracks in the image (docs/method.md, section 7)."""

import math
from typing import NamedTuple

import numpy as np

from common.geometry.transforms import wrap
from people4d.messages import F64
from services.tracker.image_sort.box_kalman import States

LEVEL_MIN = 0.2  # minimum horizontal part of an optical axis with a yaw (78 deg steep)
ANGLE_MAX_RAD = 1.5  # [rad] maximum angle to the optical axis of a point in a plane image


class Turn(NamedTuple):
    """Rotation of a camera."""

    rad: float  # [rad] rotation to the left: counter-clockwise, seen from above
    sigma_rad: float = 0.0  # [rad] standard deviation of `rad`
    up_rad: float = 0.0  # [rad] upward rotation


class Lens(NamedTuple):
    """Effect of rotations in the image."""

    px_per_rad: float  # [px/rad] width of the image over its field of view
    focal_px: float  # [px] focal length of a pinhole camera; 0: all columns move equally, section 7
    u_px: float  # [px] column of the principal point
    v_px: float  # [px] row of the principal point


class CameraDirection(NamedTuple):
    """Direction of an optical axis."""

    yaw_rad: float  # [rad] rotation to the left
    pitch_rad: float  # [rad] upward rotation
    variance_rad2: float  # [rad^2] variance of the yaw


STILL = Turn(0.0)


def camera_direction(map_from_camera: F64 | None, sigma_rad: float = 0.0) -> CameraDirection | None:
    """Return the direction of a camera (pose 4x4 in a frame with z up); None if too steep."""
    if map_from_camera is None:
        return None
    x, y, z = map_from_camera[:3, 2].tolist()
    level = math.hypot(x, y)
    if level < LEVEL_MIN:
        return None
    return CameraDirection(math.atan2(y, x), math.atan2(z, level), sigma_rad**2)


def turn_between(before: CameraDirection | None, now: CameraDirection | None) -> Turn:
    """Return the turn from one direction to another; no turn if one is unknown.

    The next turn corrects the error of an extrapolated direction.
    """
    if before is None or now is None:
        return STILL
    variance_rad2 = max(now.variance_rad2 - before.variance_rad2, 0.0)
    turn_rad = wrap(now.yaw_rad - before.yaw_rad)
    return Turn(turn_rad, math.sqrt(variance_rad2), now.pitch_rad - before.pitch_rad)


def turn_tracks(tracks: States, turn: Turn, lens: Lens) -> None:
    """Correct N tracks by a turn of the camera, before their prediction.

    Velocities then hold only the motion of the people. Turning left moves the image right:
    u <- u + turn * width / fov; turning up moves it down. In a pinhole camera a point at angle a to
    the right of the axis moves to a + turn; near the border it moves faster and grows.
    """
    x, v = tracks["x"], tracks["v"]
    tracks["pp"][..., 0] += (turn.sigma_rad * lens.px_per_rad) ** 2
    if lens.focal_px == 0:
        x[..., 0] += turn.rad * lens.px_per_rad
        x[..., 1] += turn.up_rad * lens.px_per_rad
        return
    if turn.rad != 0:
        x[..., 0], grown = turned_points(x[..., 0], turn.rad, lens.u_px, lens.focal_px)
        x[..., 1] = lens.v_px + (x[..., 1] - lens.v_px) * grown
        x[..., 2] *= grown**3  # height grows by g, width by g^2
        x[..., 3] *= grown
        v[..., 0] *= grown**2
    if turn.up_rad != 0:
        x[..., 1], grown = turned_points(x[..., 1], turn.up_rad, lens.v_px, lens.focal_px)
        x[..., 0] = lens.u_px + (x[..., 0] - lens.u_px) * grown
        x[..., 2] *= grown**3
        x[..., 3] /= grown
        v[..., 1] *= grown**2


def turned_points(
    at_px: F64, turn_rad: float, centre_px: float, focal_px: float
) -> tuple[F64, F64]:
    """Return the image positions (N) of points after a rotation, and their growth (N)."""
    before = np.arctan((at_px - centre_px) / focal_px)
    after = np.clip(before + turn_rad, -ANGLE_MAX_RAD, ANGLE_MAX_RAD)
    return centre_px + focal_px * np.tan(after), np.cos(before) / np.cos(after)
