"""Rotation of a camera and its effect on tracks in the image (docs/method.md, section 7)."""

import math
from typing import Any, NamedTuple

from common.compiled import compiled
from common.geometry.transforms import wrap
from people4d.messages import F64

LEVEL_MIN = 0.2  # a camera steeper than this (78 deg) up or down turns nothing sideways


class Turn(NamedTuple):
    """Rotation of a camera."""

    rad: float  # [rad] about the vertical, to the left, counter-clockwise seen from above
    sigma_rad: float = 0.0  # [rad] standard deviation of it
    up_rad: float = 0.0  # [rad] upwards, of a camera that is tilted


class Lens(NamedTuple):
    """Effect of rotations in the image."""

    px_per_rad: float  # [px/rad] width of the image over its field of view
    focal_px: float  # [px] of a pinhole camera; 0: all columns move alike, section 7
    u_px: float  # [px] principal point
    v_px: float  # [px] principal point


class CameraDirection(NamedTuple):
    """Direction of an optical axis."""

    yaw_rad: float  # [rad] to the left
    pitch_rad: float  # [rad] upwards
    variance_rad2: float  # [rad^2] of the yaw


STILL = Turn(0.0)


def camera_direction(map_from_camera: F64 | None, sigma_rad: float = 0.0) -> CameraDirection | None:
    """Return the direction of a camera (pose 4x4 in a frame whose z is up); None if too steep."""
    if map_from_camera is None:
        return None
    x, y, z = map_from_camera[:3, 2].tolist()
    level = math.hypot(x, y)
    if level < LEVEL_MIN:
        return None
    return CameraDirection(math.atan2(y, x), math.atan2(z, level), sigma_rad**2)


def turn_between(before: CameraDirection | None, now: CameraDirection | None) -> Turn:
    """Return the turn from one direction to another, none where one is unknown.

    An error of an extrapolated direction is corrected by the next turn.
    """
    if before is None or now is None:
        return STILL
    variance_rad2 = max(now.variance_rad2 - before.variance_rad2, 0.0)
    turn_rad = wrap(now.yaw_rad - before.yaw_rad)
    return Turn(turn_rad, math.sqrt(variance_rad2), now.pitch_rad - before.pitch_rad)


@compiled
def turn_track(track: Any, turn: Turn, lens: Lens) -> None:
    """Move a track, before its prediction, so that its velocity is the person's own motion.

    Turning left moves the image right: u <- u + turn * width / fov, turning up moves it down. In a
    pinhole camera, a point at angle a to the right of the axis moves to a + turn; near the rim it
    moves faster and grows.
    """
    track.pp[0] += (turn.sigma_rad * lens.px_per_rad) ** 2
    if lens.focal_px == 0:
        track.x[0] += turn.rad * lens.px_per_rad
        track.x[1] += turn.up_rad * lens.px_per_rad
        return
    if turn.rad != 0:
        track.x[0], grown = turned_point(track.x[0], turn.rad, lens.u_px, lens.focal_px)
        track.x[1] = lens.v_px + (track.x[1] - lens.v_px) * grown
        track.x[2] *= grown**3  # the height grows by that, the width by its square
        track.x[3] *= grown
        track.v[0] *= grown**2
    if turn.up_rad != 0:
        track.x[1], grown = turned_point(track.x[1], turn.up_rad, lens.v_px, lens.focal_px)
        track.x[0] = lens.u_px + (track.x[0] - lens.u_px) * grown
        track.x[2] *= grown**3
        track.x[3] /= grown
        track.v[1] *= grown**2


@compiled
def turned_point(
    at_px: float, turn_rad: float, centre_px: float, focal_px: float
) -> tuple[float, float]:
    """Return the image position of a point after a rotation, and by how much it grew."""
    before = math.atan((at_px - centre_px) / focal_px)
    after = before + turn_rad
    if abs(after) >= 1.5:  # [rad] beside the camera, outside of any plane image
        after = math.copysign(1.5, after)
    return centre_px + focal_px * math.tan(after), math.cos(before) / math.cos(after)
