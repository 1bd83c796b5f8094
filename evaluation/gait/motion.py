"""Joints of a person over a recording, and the angles of the legs over the cycle of walking.

Angles are in the plane of walking; flexion of hip and knee and dorsiflexion of the ankle are above
0. Keypoints have no toes: the foot is assumed level up to FLAT, where the heel rises.

Source: docs/method.md, section 20.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64, PersonSkeleton
from people4d.messages.skeleton import JOINTS
from services.gait.steps.steps import FEET, FootStep

SIGMA_MAX_M = 0.15  # Maximum standard deviation of an exported joint [m]
GAP_S = 0.3  # Maximum time between known positions of an interpolated joint [s]
SAME_S = 1e-6  # Maximum difference of equal times [s]
FLAT = 0.4  # End of the part of the stride with a level foot
CYCLE_STEPS = 101  # Number of samples of a cycle: 0 to 100 %
ANGLES = ("hip", "knee", "ankle")
ANGLE_FIELDS = (
    *("person", "foot", "cycle_percent", "strides"),
    *(f"{name}_{figure}_deg" for name in ANGLES for figure in ("mean", "sd")),
)
SHOULDERS, HIPS = (
    tuple(JOINTS.index(f"{side}_{name}") for side in FEET) for name in ("shoulder", "hip")
)


@dataclass(frozen=True)
class JointMotion:
    """Joints of one person at a constant rate."""

    start_s: float
    rate_hz: float
    joints_m: F64  # Tx17x3, COCO order, z up; NaN if unknown

    @property
    def times_s(self) -> F64:
        """Times of the samples."""
        return self.start_s + np.arange(len(self.joints_m)) / self.rate_hz


def motion_of(times_s: Sequence[float], people: Sequence[PersonSkeleton]) -> JointMotion | None:
    """Return the joints of a person at the median rate; None with fewer than two frames."""
    if len(times_s) < 2:
        return None
    known_s = np.asarray(times_s)
    rate_hz = 1 / float(np.median(np.diff(known_s)))
    grid_s = known_s[0] + np.arange(round((known_s[-1] - known_s[0]) * rate_hz) + 1) / rate_hz
    joints_m = np.full((len(grid_s), len(JOINTS), 3), np.nan)
    for joint in range(len(JOINTS)):
        certain = [np.trace(one.covariances_m2[joint]) < 3 * SIGMA_MAX_M**2 for one in people]
        positions_m = np.array([one.positions_m[joint] for one in people], np.float64)[certain]
        joints_m[:, joint] = _interpolated(grid_s, known_s[certain], positions_m)
    return JointMotion(float(known_s[0]), rate_hz, joints_m)


def leg_angles(joints_m: F64) -> F64:
    """Return the angles of hip, knee and ankle of the left and the right leg, Nx2x3 [degrees].

    `joints_m` are Nx17x3, z up.
    """
    hips_m, shoulders_m = joints_m[:, HIPS], joints_m[:, SHOULDERS]
    aside = hips_m[:, 0] - hips_m[:, 1] + shoulders_m[:, 0] - shoulders_m[:, 1]
    ahead = np.cross(aside * (1.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    torso = _lean(hips_m.mean(axis=1) - shoulders_m.mean(axis=1), ahead)
    angles = np.empty((len(joints_m), 2, 3))
    for leg, foot in enumerate(FEET):
        hip_m, knee_m, ankle_m = (
            joints_m[:, JOINTS.index(f"{foot}_{name}")] for name in ("hip", "knee", "ankle")
        )
        thigh, shank = _lean(knee_m - hip_m, ahead), _lean(ankle_m - knee_m, ahead)
        angles[:, leg] = np.stack([thigh - torso, thigh - shank, -shank], axis=1)
    return np.degrees(angles)


def cycles(motion: JointMotion, steps: Sequence[FootStep], foot: str) -> F64:
    """Return hip, knee and ankle of a leg in each stride, from landing to landing, SxCYCLE_STEPSx3.

    The ankle is NaN after FLAT.
    """
    angles = leg_angles(motion.joints_m)[:, FEET.index(foot)]
    ratios, found = np.linspace(0, 1, CYCLE_STEPS), []
    for step in steps:
        if step.foot == foot and step.stride:
            times_s = step.landed_s - step.stride.time_s * (1 - ratios)
            found.append(_interpolated(times_s, motion.times_s, angles))
    table = np.array(found).reshape(-1, CYCLE_STEPS, len(ANGLES))
    table[:, ratios > FLAT, ANGLES.index("ankle")] = np.nan
    return table


def angle_rows(
    person: int, motion: JointMotion, steps: Sequence[FootStep]
) -> Iterator[list[object]]:
    """Yield the rows of joint_angles.csv: mean and standard deviation over strides."""
    for foot in FEET:
        table = cycles(motion, steps, foot)
        known = np.isfinite(table)
        counts = known.sum(axis=0)
        mean = np.where(known, table, 0.0).sum(axis=0) / np.where(counts > 0, counts, np.nan)
        squares = np.where(known, table - mean, 0.0) ** 2
        spread = np.sqrt(squares.sum(axis=0) / np.where(counts > 1, counts - 1, np.nan))
        for percent in range(CYCLE_STEPS if len(table) else 0):
            pairs = np.stack([mean[percent], spread[percent]], axis=1).ravel().tolist()
            yield [person, foot, percent, int(counts[percent].max()), *pairs]


def _lean(vectors: F64, ahead: F64) -> F64:
    """Return the angle of downward vectors (Nx3) ahead of vertical, in the plane of walking."""
    return np.asarray(np.arctan2(np.sum(vectors * ahead, axis=1), -vectors[:, 2]))


def _interpolated(at_s: F64, known_s: F64, values: F64) -> F64:
    """Return values (NxK) at other times; NaN in gaps above GAP_S and outside the known times."""
    found = np.full((len(at_s), values.shape[1]), np.nan)
    finite = np.isfinite(values).all(axis=1)
    known_s, values = known_s[finite], values[finite]
    before = np.searchsorted(known_s, at_s + SAME_S, side="right") - 1
    after = np.searchsorted(known_s, at_s - SAME_S)
    near = (before >= 0) & (after < len(known_s))
    near[near] = known_s[after[near]] - known_s[before[near]] <= GAP_S
    if not near.any():
        return found
    for k in range(values.shape[1]):
        found[near, k] = np.interp(at_s[near], known_s, values[:, k])
    return found
