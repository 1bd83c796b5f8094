"""Relative pose and clock offset of two cameras, from paths of unidentified people.

Each pair of paths that overlap in time proposes a pose for each offset of the clocks. The pose with
the most matched and the fewest missing people is used.
"""

from dataclasses import dataclass, replace

import numpy as np

from common.calibration.level_paths import LevelPaths
from common.calibration.tracklets import STEP_S
from people4d.messages import F64

OVERLAP_STEPS = 15  # minimum overlap of two paths that propose a pose
EXTENT_M = 0.6  # minimum extent of paths that propose a pose [m]
RMS_MAX_M = 0.15  # maximum RMS distance of these paths at the proposed pose [m]
PROPOSALS_MAX = 240  # maximum number of scored proposals
GATE_M, HEIGHT_GATE_M = 0.3, 0.3  # maximum distance of two positions of one person [m]
APART_M = 0.7  # minimum distance of a person that is missing in the other camera [m]
MISSING_WEIGHT = 0.5
# Minimum difference of two distinct poses [m, rad, s]
DISTINCT_M, DISTINCT_RAD, DISTINCT_S = 0.5, 0.25, 0.35
REFINED = 4  # number of refined poses
ROUNDS = 6  # rounds of the refinement


@dataclass(frozen=True, slots=True)
class LevelPose:
    """Pose of camera b in the level frame of camera a, and clock of b minus clock of a."""

    yaw_rad: float
    translation_m: F64  # 3
    offset_s: float
    score: float = 0.0
    matched: int = 0  # number of matched positions
    missing: int = 0
    tilted: F64 | None = None  # 3x3, replaces the yaw

    @property
    def rotation(self) -> F64:
        """3x3, a from b."""
        if self.tilted is not None:
            return self.tilted
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])

    def apply(self, points_m: F64) -> F64:
        """Return points (...x3) of b in the level frame of a."""
        return np.asarray(points_m @ self.rotation.T + self.translation_m)

    def is_distinct(self, other: "LevelPose", at_m: F64) -> bool:
        """Check that another pose is a distinct solution for people around a position (b)."""
        turned = (self.yaw_rad - other.yaw_rad + np.pi) % (2 * np.pi) - np.pi
        moved = np.linalg.norm(self.apply(at_m) - other.apply(at_m))
        return bool(
            abs(turned) > DISTINCT_RAD
            or moved > DISTINCT_M
            or abs(self.offset_s - other.offset_s) > DISTINCT_S
        )


@dataclass(frozen=True)
class PairResult:
    """The best pose of a pair, and the best different one."""

    best: LevelPose | None
    second: LevelPose | None = None


def match_pair(a: LevelPaths, b: LevelPaths, offset_s: float, search_s: float) -> PairResult:
    """Return the pose of camera b in a, with its clock.

    Args:
        a: Reference camera.
        b: Camera whose pose is returned.
        offset_s: Expected clock of b minus the clock of a [s].
        search_s: Maximum difference from the expectation [s].
    """
    shifts = range(round((offset_s - search_s) / STEP_S), round((offset_s + search_s) / STEP_S) + 1)
    proposals = _proposals(a, b, shifts)
    if not proposals:
        return PairResult(None)
    scored = sorted((score(a, b, p) for p in proposals), key=lambda p: -p.score)
    middle = np.nanmean(b.positions_m, axis=(0, 1))
    chosen: list[LevelPose] = []
    for pose in scored:
        if len(chosen) < REFINED and all(pose.is_distinct(other, middle) for other in chosen):
            chosen.append(pose)
    refined = sorted((refine(a, b, pose) for pose in chosen), key=lambda p: -p.score)
    best = refined[0]
    others = [p for p in refined[1:] if p.is_distinct(best, middle)]
    return PairResult(best, others[0] if others else None)


def _proposals(a: LevelPaths, b: LevelPaths, shifts: range) -> list[LevelPose]:
    found: list[tuple[float, LevelPose]] = []
    for one in a.paths:
        if one.extent_m < EXTENT_M:
            continue
        first_m = one.positions_m @ a.level_from_optical.T
        for other in b.paths:
            if other.extent_m < EXTENT_M:
                continue
            second_m = other.positions_m @ b.level_from_optical.T
            for shift in shifts:
                begin = max(one.first, other.first - shift)
                end = min(one.last, other.last - shift)
                if end - begin < OVERLAP_STEPS:
                    continue
                p = first_m[begin - one.first : end - one.first]
                q = second_m[begin + shift - other.first : end + shift - other.first]
                pose, rms_m, spread_m = _aligned(p, q, shift)
                if rms_m < RMS_MAX_M and spread_m > EXTENT_M / 3:
                    found.append((min(end - begin, 60) * spread_m / (rms_m + 0.03), pose))
    found.sort(key=lambda item: -item[0])
    return [pose for _, pose in found[:PROPOSALS_MAX]]


def _aligned(p: F64, q: F64, shift: int) -> tuple[LevelPose, float, float]:
    """Return the pose that maps path q to path p, the remaining distance, and the spread of p."""
    zp, zq = p[:, 0] + 1j * p[:, 1], q[:, 0] + 1j * q[:, 1]
    mp, mq = zp.mean(), zq.mean()
    inner = np.vdot(zq - mq, zp - mp)
    turn = inner / max(abs(inner), 1e-12)
    left = (zp - mp) - turn * (zq - mq)
    dz = p[:, 2] - q[:, 2]
    offset = mp - turn * mq
    pose = LevelPose(
        float(np.angle(turn)),
        np.array([offset.real, offset.imag, float(dz.mean())]),
        shift * STEP_S,
    )
    rms_m = float(np.sqrt((np.abs(left) ** 2).mean() + dz.var()))
    return pose, rms_m, float(np.sqrt((np.abs(zp - mp) ** 2).mean()))


def _overlap(a: LevelPaths, b: LevelPaths, shift: int) -> tuple[slice, slice]:
    """Return the rows of both arrays at the same times."""
    begin = max(a.first, b.first - shift)
    end = min(a.first + len(a.positions_m), b.first + len(b.positions_m) - shift)
    end = max(begin, end)
    return (
        slice(begin - a.first, end - a.first),
        slice(begin + shift - b.first, end + shift - b.first),
    )


def _distances(pa: F64, pb: F64) -> F64:
    """Return distances (TxKaxKb), infinite where heights differ too much or one is absent."""
    apart = pa[:, :, None] - pb[:, None, :]
    level = np.hypot(apart[..., 0], apart[..., 1])
    level[~(np.abs(apart[..., 2]) < HEIGHT_GATE_M)] = np.inf
    return np.asarray(np.where(np.isnan(level), np.inf, level))


def score(a: LevelPaths, b: LevelPaths, pose: LevelPose) -> LevelPose:
    """Return a pose with its score: matched positions less missing ones."""
    rows_a, rows_b = _overlap(a, b, round(pose.offset_s / STEP_S))
    pa, pb = a.positions_m[rows_a], pose.apply(b.positions_m[rows_b])
    if not len(pa):
        return replace(pose, score=0.0, matched=0, missing=0)
    distance = _distances(pa, pb)
    matched = int((distance.min(axis=1) < GATE_M).sum())
    back = (pa - pose.translation_m) @ pose.rotation
    # Missing in the other camera, in its region of reliable detections.
    lone_b = a.in_view(pb) & ~np.isnan(pb[..., 0]) & (distance.min(axis=1) > APART_M)
    lone_a = b.in_view(back) & ~np.isnan(pa[..., 0]) & (distance.min(axis=2) > APART_M)
    missing = int(lone_a.sum() + lone_b.sum())
    return replace(pose, score=matched - MISSING_WEIGHT * missing, matched=matched, missing=missing)


def _correspond(
    a: LevelPaths, b: LevelPaths, pose: LevelPose, gate_m: float
) -> tuple[F64, F64, F64]:
    """Return positions of the same people at a pose: in a, in b, and velocities in b, Nx3 each."""
    shift, share = divmod(pose.offset_s / STEP_S, 1.0)
    rows_a, rows_b = _overlap(a, b, int(shift))
    positions, velocities = b.between(share)
    pa, pb, vb = a.positions_m[rows_a], positions[rows_b], velocities[rows_b]
    if not len(pa):
        empty = np.zeros((0, 3))
        return empty, empty, empty
    distance = _distances(pa, pose.apply(pb))
    nearest = distance.argmin(axis=2)
    mutual = distance.argmin(axis=1)
    t, i = np.nonzero(distance.min(axis=2) < gate_m)
    j = nearest[t, i]
    good = mutual[t, j] == i
    t, i, j = t[good], i[good], j[good]
    return pa[t, i], pb[t, j], vb[t, j]


def refine(a: LevelPaths, b: LevelPaths, pose: LevelPose) -> LevelPose:
    """Return a pose fitted to all positions matched by it, with its score."""
    for k in range(ROUNDS):
        at_a, at_b, moving_b = _correspond(a, b, pose, GATE_M if k < 3 else 0.2)
        if len(at_a) < OVERLAP_STEPS:
            break
        b_m = pose.apply(at_b)
        velocity = moving_b @ pose.rotation.T
        error = at_a - b_m
        about = b_m - pose.translation_m
        n = len(error)
        jacobian = np.zeros((n, 3, 5))  # yaw, translation, offset
        jacobian[:, 0, 0], jacobian[:, 1, 0] = -about[:, 1], about[:, 0]
        jacobian[:, [0, 1, 2], [1, 2, 3]] = 1.0
        jacobian[:, :, 4] = velocity
        size = np.linalg.norm(error, axis=1)
        weight = np.sqrt(np.minimum(1.0, 0.06 / np.maximum(size, 1e-6)))[:, None]
        left = (jacobian * weight[..., None]).reshape(-1, 5)
        damped = np.vstack([left, np.diag([0.0, 0.0, 0.0, 0.0, 0.1])])
        right = np.append((error * weight).ravel(), np.zeros(5))
        step, *_ = np.linalg.lstsq(damped, right, rcond=None)
        pose = replace(
            pose,
            yaw_rad=pose.yaw_rad + float(step[0]),
            translation_m=pose.translation_m + step[1:4],
            offset_s=pose.offset_s + float(np.clip(step[4], -0.1, 0.1)),
        )
    return score(a, b, pose)
