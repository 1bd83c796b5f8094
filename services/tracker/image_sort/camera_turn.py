"""What the turning of a camera does to tracks in its image (method book section 7)."""

import math
from typing import Any, NamedTuple

from common.compiled import compiled


class Turn(NamedTuple):
    """How far a camera has turned."""

    rad: float  # [rad] about the vertical, to the left, counter-clockwise seen from above
    sigma_rad: float = 0.0  # [rad] standard deviation of it
    up_rad: float = 0.0  # [rad] upwards, of a camera that is tilted


class Lens(NamedTuple):
    """How turns show in the image."""

    px_per_rad: float  # [px/rad] width of the image over its field of view
    focal_px: float  # [px] of a pinhole camera; 0: all columns move alike, section 7
    u_px: float  # [px] principal point
    v_px: float  # [px] principal point


STILL = Turn(0.0)


@compiled
def turn_track(track: Any, turn: Turn, lens: Lens) -> None:
    """Move a track so that its velocity holds only the person's own motion.

    Turning left moves the image right: u <- u + turn * width / fov, turning up moves it down. Of a
    pinhole camera, what was seen by the angle a to the right of the axis is then seen by a + turn;
    near the rim it moves faster and grows.

    Args:
        track: Record of `box_kalman.TRACK`, before its prediction.
        turn: Since the last frame.
        lens: Of the camera.
    """
    track.pp[0] += (turn.sigma_rad * lens.px_per_rad) ** 2
    if lens.focal_px == 0:
        track.x[0] += turn.rad * lens.px_per_rad
        track.x[1] += turn.up_rad * lens.px_per_rad
        return
    if turn.rad != 0:
        track.x[0], grown = seen_after(track.x[0], turn.rad, lens.u_px, lens.focal_px)
        track.x[1] = lens.v_px + (track.x[1] - lens.v_px) * grown
        track.x[2] *= grown**3  # the height grows by that, the width by its square
        track.x[3] *= grown
        track.v[0] *= grown**2
    if turn.up_rad != 0:
        track.x[1], grown = seen_after(track.x[1], turn.up_rad, lens.v_px, lens.focal_px)
        track.x[0] = lens.u_px + (track.x[0] - lens.u_px) * grown
        track.x[2] *= grown**3
        track.x[3] /= grown
        track.v[1] *= grown**2


@compiled
def seen_after(
    at_px: float, turn_rad: float, centre_px: float, focal_px: float
) -> tuple[float, float]:
    """Return where a point is seen after a turn across the image, and by how much it grew."""
    before = math.atan((at_px - centre_px) / focal_px)
    after = before + turn_rad
    if abs(after) >= 1.5:  # [rad] beside the camera, where a plane image has no place for it
        after = math.copysign(1.5, after)
    return centre_px + focal_px * math.tan(after), math.cos(before) / math.cos(after)
