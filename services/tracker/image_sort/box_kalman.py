"""The Kalman filter of a box in the image: state u, v, s, r, du, dv, ds.

u, v is the centre of the box, s its area and r its width over its height, which has no velocity.
In SORT all covariances are diagonal at the start, and neither motion nor measurement mix u, v, s
and r. So the filter of seven states is exactly three filters of [position, velocity] and one of
[position], and each is a handful of multiplications.

Source: docs/method.md, section 7; the constants are those of [Bewley 2016].
"""

from typing import Any

import numpy as np

from common.compiled import compiled
from people4d.messages import F64

TRACK = np.dtype(
    [
        ("id", np.int64),
        ("x", np.float64, 4),  # u, v, s, r
        ("v", np.float64, 3),  # du, dv, ds, for each frame
        ("pp", np.float64, 4),  # variances of u, v, s, r
        ("pv", np.float64, 3),  # covariances of u, v, s with their velocities
        ("vv", np.float64, 3),  # variances of the velocities
        ("box", np.float64, 4),  # [px] xyxy of the state
        ("score", np.float64),  # of the last matched detection
        ("detection", np.int64),  # index of the detection matched in this frame, -1 if none
        ("hits", np.int64),  # frames matched, the first included
        ("streak", np.int64),  # frames matched since the last miss, the first match excluded
        ("missed", np.int64),  # frames since the last match
        ("confirmed", np.bool_),
        ("matched_ns", np.int64),  # [ns] stamp of the last match
    ]
)

# Variances of u, v, s, r and of the velocities of u, v, s; for each frame in pixels and pixels^2.
START, START_VELOCITY = (10.0, 10.0, 10.0, 10.0), (1e4, 1e4, 1e4)
PROCESS, PROCESS_VELOCITY = (1.0, 1.0, 1.0, 1.0), (0.01, 0.01, 0.0001)
MEASURED = (1.0, 1.0, 10.0, 10.0)


@compiled
def begin(track: Any, box: F64) -> None:
    """Start with a measured box (4, xyxy, pixels), velocities of 0 and their variances."""
    measure(box, track.x)
    for k in range(4):
        track.pp[k] = START[k]
    for k in range(3):
        track.v[k] = track.pv[k] = 0.0
        track.vv[k] = START_VELOCITY[k]
    write_box(track)


@compiled
def predict(track: Any, steps: float) -> None:
    """Predict the state a number of frames ahead.

    An area that would vanish stops shrinking, as in SORT.
    """
    if track.x[2] + steps * track.v[2] <= 0:
        track.v[2] = 0.0
    for k in range(3):
        track.x[k] += steps * track.v[k]
        track.pp[k] += steps * (2 * track.pv[k] + steps * track.vv[k])
        track.pv[k] += steps * track.vv[k]
        track.vv[k] += steps * PROCESS_VELOCITY[k]
    for k in range(4):
        track.pp[k] += steps * PROCESS[k]
    write_box(track)


@compiled
def correct(track: Any, box: F64) -> None:
    """Update the state with a measured box (4, xyxy, pixels)."""
    z = np.empty(4)
    measure(box, z)
    for k in range(4):
        S = track.pp[k] + MEASURED[k]
        K, y = track.pp[k] / S, z[k] - track.x[k]
        track.x[k] += K * y
        track.pp[k] *= 1 - K
        if k < 3:
            K_v = track.pv[k] / S
            track.v[k] += K_v * y
            track.vv[k] -= K_v * track.pv[k]
            track.pv[k] *= 1 - K
    write_box(track)


@compiled
def measure(box: F64, z: F64) -> None:
    """Write u, v, s, r of a box (4, xyxy, pixels) to z."""
    width, height = box[2] - box[0], box[3] - box[1]
    z[0], z[1] = box[0] + width / 2, box[1] + height / 2
    z[2], z[3] = width * height, width / height


@compiled
def write_box(track: Any) -> None:
    """Write the box of the state."""
    u, v, s, r = track.x[0], track.x[1], track.x[2], track.x[3]
    width = np.sqrt(max(s * r, 0.0))
    height = s / width if width > 0 else 0.0
    track.box[0], track.box[1] = u - width / 2, v - height / 2
    track.box[2], track.box[3] = u + width / 2, v + height / 2
