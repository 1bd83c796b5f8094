"""Path of the robot, and its closest approach to people."""

import math

import numpy as np

from people4d.messages import F64

FINE_S = 0.1  # interval between the compared times [s]


def path_ahead(pose: F64, before: F64, elapsed_s: float, times_s: F64) -> F64:
    """Extrapolate the motion between two poses at constant speed and turn rate.

    Args:
        pose: 4x4 pose of the base now.
        before: 4x4 pose earlier.
        elapsed_s: Interval between the poses [s], > 0.
        times_s: H times ahead [s].

    Returns:
        Hx2 positions [m].
    """
    x, y, yaw = pose[0, 3], pose[1, 3], math.atan2(pose[1, 0], pose[0, 0])
    chord = pose[:2, :2].T @ (pose[:2, 3] - before[:2, 3])
    turn = yaw - math.atan2(before[1, 0], before[0, 0])
    omega = math.remainder(turn, 2 * math.pi) / elapsed_s
    # The chord is parallel to the middle of the arc, and shorter than the arc.
    half = omega * elapsed_s / 2
    moved = chord / (elapsed_s * np.sinc(half / math.pi))
    forward = moved[0] * math.cos(half) - moved[1] * math.sin(half)
    left = moved[0] * math.sin(half) + moved[1] * math.cos(half)
    angle = omega * times_s
    along = np.sinc(angle / math.pi) * times_s  # sin(angle) / omega
    across = np.sin(angle / 2) * np.sinc(angle / 2 / math.pi) * times_s  # (1 - cos) / omega
    ahead = forward * along - left * across
    aside = forward * across + left * along
    c, s = math.cos(yaw), math.sin(yaw)
    return np.stack([x + c * ahead - s * aside, y + s * ahead + c * aside], axis=1)


def encounters(paths_m: F64, robot_m: F64, step_s: float) -> F64:
    """Compare the paths of people with the path of the robot.

    Args:
        paths_m: NxTx2 positions of people at equally spaced times, the first one now [m].
        robot_m: Tx2 positions of the robot at the same times [m].
        step_s: Interval [s].

    Returns:
        Nx3: time of the closest approach [s], distance then [m], distance of the paths [m].
    """
    apart = np.linalg.norm(paths_m - robot_m, axis=2)
    at = apart.argmin(axis=1)
    paths = np.linalg.norm(paths_m[:, :, None] - robot_m[None, None], axis=3)
    return np.stack([at * step_s, apart[np.arange(len(at)), at], paths.min(axis=(1, 2))], axis=1)
