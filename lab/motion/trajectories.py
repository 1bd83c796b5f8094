"""Recorded paths of people, followed as they are."""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from lab.motion.crowd import CrowdPaths
from lab.motion.walker import STEP_S
from people4d.messages import F64

SMOOTH_S = 0.25  # of positions, whose samples are tenths of a second apart
STANDING_MPS = 0.15  # slower people stand, and turn no more
TURN_SMOOTH_S = 0.15  # of the direction in which they walk


def follow(samples: Sequence[F64], times_s: F64) -> CrowdPaths:
    """Return the paths of people through samples, at T times in steps of STEP_S.

    Before their first sample and after their last people stand there. They face the direction in
    which they walk, and keep it standing.

    Args:
        samples: Of each person: Nx3 rising time in s, x and y in m, frame: map.
        times_s: T.
    """
    paths = [_path(one, times_s) for one in samples]
    x, y, yaw = (np.array([path[k] for path in paths]) for k in range(3))
    still = np.zeros_like(x)
    return CrowdPaths(times_s, x, y, yaw, still, still)


def _path(samples: F64, times_s: F64) -> tuple[F64, F64, F64]:
    if len(samples) == 1:
        x, y = (np.full(len(times_s), value) for value in samples[0, 1:])
        return x, y, np.zeros(len(times_s))
    at_s = np.clip(times_s, samples[0, 0], samples[-1, 0])
    raw = PchipInterpolator(samples[:, 0], samples[:, 1:])(at_s)
    x, y = gaussian_filter1d(raw, SMOOTH_S / STEP_S, axis=0, mode="nearest").T
    vx, vy = np.gradient(x, STEP_S), np.gradient(y, STEP_S)
    walks = np.flatnonzero(np.hypot(vx, vy) > STANDING_MPS)
    if not len(walks):
        return x, y, np.zeros(len(times_s))
    yaw = np.unwrap(np.arctan2(vy[walks], vx[walks]))
    yaw = np.interp(np.arange(len(times_s)), walks, yaw)
    return x, y, gaussian_filter1d(yaw, TURN_SMOOTH_S / STEP_S, mode="nearest")
