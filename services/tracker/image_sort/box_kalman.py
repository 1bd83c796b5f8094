"""The Kalman filter of boxes in the image: state u, v, s, r, du, dv, ds.

u, v is the centre of the box, s its area and r its width over its height, which has no velocity.
In SORT all initial covariances are diagonal, and neither motion nor measurement mix u, v, s and r.
So the filter of seven states equals three filters of [position, velocity] and one of [position],
computed for all tracks at once.

Source: docs/method.md, section 7; constants of [Bewley 2016].
"""

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from people4d.messages import F64

TRACK = np.dtype(
    [
        ("id", np.int64),
        ("x", np.float64, 4),  # u, v, s, r
        ("v", np.float64, 3),  # du, dv, ds per frame
        ("pp", np.float64, 4),  # variances of u, v, s, r
        ("pv", np.float64, 3),  # covariances of u, v, s with their velocities
        ("vv", np.float64, 3),  # variances of the velocities
        ("box", np.float64, 4),  # [px] xyxy
        ("score", np.float64),  # score of the last matched detection
        ("detection", np.int64),  # index of the detection matched in this frame, -1 if none
        ("hits", np.int64),  # frames matched, the first included
        ("streak", np.int64),  # frames matched since the last miss, the first match excluded
        ("missed", np.int64),  # frames since the last match
        ("confirmed", np.bool_),
        ("matched_ns", np.int64),  # [ns] stamp of the last match
    ]
)
Records: TypeAlias = npt.NDArray[Any]  # N records of type TRACK
States: TypeAlias = Records | np.void  # N records or a single one

# Variances of u, v, s, r and of the velocities of u, v, s per frame, in px and px^2
START, START_VELOCITY = np.array([10.0, 10.0, 10.0, 10.0]), np.array([1e4, 1e4, 1e4])
PROCESS, PROCESS_VELOCITY = np.array([1.0, 1.0, 1.0, 1.0]), np.array([0.01, 0.01, 0.0001])
MEASURED = np.array([1.0, 1.0, 10.0, 10.0])


def begin(tracks: States, boxes: F64) -> None:
    """Begin tracks with measured boxes (Nx4, xyxy, pixels) and velocities of 0."""
    tracks["x"][...] = measure(boxes)
    tracks["pp"][...], tracks["vv"][...] = START, START_VELOCITY
    tracks["v"][...] = tracks["pv"][...] = 0.0
    write_boxes(tracks)


def predict(tracks: States) -> None:
    """Predict the states one frame ahead; areas stay positive, as in SORT."""
    x, v, pp, pv, vv = (tracks[name] for name in ("x", "v", "pp", "pv", "vv"))
    v[..., 2] = np.where(x[..., 2] + v[..., 2] <= 0, 0.0, v[..., 2])
    x[..., :3] += v
    pp[..., :3] += 2 * pv + vv
    pv += vv
    vv += PROCESS_VELOCITY
    pp += PROCESS
    write_boxes(tracks)


def correct(tracks: States, boxes: F64) -> None:
    """Update the states with measured boxes (Nx4, xyxy, pixels)."""
    x, v, pp, pv, vv = (tracks[name] for name in ("x", "v", "pp", "pv", "vv"))
    S = pp + MEASURED
    K, K_v, y = pp / S, pv / S[..., :3], measure(boxes) - x
    x += K * y
    pp *= 1 - K
    v += K_v * y[..., :3]
    vv -= K_v * pv
    pv *= 1 - K[..., :3]
    write_boxes(tracks)


def measure(boxes: F64) -> F64:
    """Return u, v, s, r (Nx4) of boxes (Nx4, xyxy, pixels)."""
    left, top, right, bottom = np.moveaxis(boxes, -1, 0)
    width, height = right - left, bottom - top
    state = (left + width / 2, top + height / 2, width * height, width / height)
    return np.stack(state, axis=-1)


def write_boxes(tracks: States) -> None:
    """Write the boxes of the states."""
    u, v, s, r = np.moveaxis(tracks["x"], -1, 0)
    width = np.sqrt(np.maximum(s * r, 0.0))
    height = np.where(width > 0, s, 0.0) / np.where(width > 0, width, 1.0)
    corners = (u - width / 2, v - height / 2, u + width / 2, v + height / 2)
    tracks["box"][...] = np.stack(corners, axis=-1)
