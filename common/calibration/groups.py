"""Positions of one person in all cameras at one time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from common.calibration.level_paths import BOOL, LevelPaths
from common.calibration.pairs import HEIGHT_GATE_M, LevelPose
from common.calibration.tracklets import LIMBS_COUNT, STEP_S
from people4d.messages import F64

TIMES_MAX = 2000  # maximum number of times
LIMB_STEPS = 4  # interval between uses of a joint [times]


@dataclass(frozen=True, slots=True)
class Groups:
    """Positions of people in view of two cameras or more: G people and times, C cameras.

    First the torsos, then joints at the distance of their torso.
    """

    torsos: int  # number of rows that are torsos
    times_s: F64  # G, on the clock of the reference, from the middle of the time
    has: BOOL  # GxC, True if the person is in view of the camera
    points_m: F64  # GxCx3, frames: optical; 1 m ahead if the person is not in view
    velocities_mps: F64  # GxCx3
    step_s: float  # [s] interval of times
    offsets_s: F64  # C, delay of the positions on the clocks of the cameras

    def pair(self, a: int, b: int) -> BOOL:
        """Return flags (G) of the torsos in view of both cameras."""
        return np.asarray(
            self.has[:, a] & self.has[:, b] & (np.arange(len(self.has)) < self.torsos)
        )


def find_groups(
    cameras: Sequence[LevelPaths], poses: Mapping[str, LevelPose], gate_m: float, middle: int
) -> Groups:
    """Return positions of the same people in several cameras, matched to the nearest person.

    Args:
        cameras: Paths; the first camera is the reference.
        poses: Poses in the level frame of the reference, by camera.
        gate_m: Maximum distance on the ground [m].
        middle: Grid step of the reference in the middle of the observed time.
    """
    shifts = [divmod(poses[c.camera].offset_s / STEP_S, 1.0) for c in cameras]
    first = min(c.first - int(shift) for c, (shift, _) in zip(cameras, shifts, strict=True))
    last = max(
        c.first + len(c.positions_m) - int(shift)
        for c, (shift, _) in zip(cameras, shifts, strict=True)
    )
    stride = max(1, (last - first) // TIMES_MAX)
    steps = np.arange(first, last, stride)
    people: list[tuple[F64, F64, F64, F64]] = []  # own positions; velocities, joints, positions
    for camera, (shift, share) in zip(cameras, shifts, strict=True):
        positions, velocities = camera.between(share)
        rows = steps + int(shift) - camera.first
        absent = (rows < 0) | (rows >= len(positions))
        at = positions[rows.clip(0, len(positions) - 1)]
        at[absent] = np.nan
        speed = velocities[rows.clip(0, len(positions) - 1)]
        pose = poses[camera.camera]
        limbs_at = camera.limbs_between(share)[rows.clip(0, len(positions) - 1)]
        people.append((at, speed @ pose.rotation.T, limbs_at, pose.apply(at)))
    times: list[int] = []
    members: list[dict[int, int]] = []
    for k in range(len(steps)):
        found = _join([mapped[k] for *_, mapped in people], gate_m)
        times += [k] * len(found)
        members += found
    count, cameras_count = len(members), len(cameras)
    points = np.tile((0.0, 0.0, 1.0), (count, cameras_count, 1))
    moving = np.zeros_like(points)
    has = np.zeros((count, cameras_count), np.bool_)
    limbs = np.full((count, cameras_count, LIMBS_COUNT, 2), np.nan)
    for g, (k, group) in enumerate(zip(times, members, strict=True)):
        # The mean velocity, since errors of a camera's own velocity bias its clock.
        mean = np.mean([people[c][1][k, column] for c, column in group.items()], axis=0)
        for c, column in group.items():
            has[g, c] = True
            points[g, c] = people[c][0][k, column] @ cameras[c].level_from_optical
            moving[g, c] = mean @ poses[cameras[c].camera].rotation @ cameras[c].level_from_optical
            limbs[g, c] = people[c][2][k, column]
    # Joints of consecutive times have correlated errors: each is used every fourth time.
    turn = (np.array(times, np.int64)[:, None] + np.arange(LIMBS_COUNT)) % LIMB_STEPS == 0
    has_limb = ~np.isnan(limbs[..., 0])
    rows, joints = np.nonzero(turn & (has_limb.sum(axis=1) > 1))
    rays = np.nan_to_num(limbs[rows, :, joints])
    ones = np.ones((*rays.shape[:2], 1))
    limb_points = np.concatenate([rays, ones], axis=2) * points[rows, :, 2:]
    return Groups(
        torsos=count,
        times_s=np.asarray(
            (steps[np.array(times, np.int64)[np.append(np.arange(count), rows)]] - middle) * STEP_S,
            np.float64,
        ),
        has=np.concatenate([has, has_limb[rows, :, joints]]),
        points_m=np.concatenate([points, limb_points]),
        velocities_mps=np.concatenate([moving, moving[rows]]),
        step_s=stride * STEP_S,
        offsets_s=np.array([poses[c.camera].offset_s for c in cameras]),
    )


def _join(positions_m: Sequence[F64], gate_m: float) -> list[dict[int, int]]:
    """Return the people in two cameras or more at one time: their columns by camera."""
    columns = [np.flatnonzero(~np.isnan(at[:, 0])) for at in positions_m]
    links: list[tuple[float, tuple[int, int], tuple[int, int]]] = []
    for a, b in combinations(range(len(positions_m)), 2):
        if not len(columns[a]) or not len(columns[b]):
            continue
        apart = positions_m[a][columns[a]][:, None] - positions_m[b][columns[b]]
        level = np.hypot(apart[..., 0], apart[..., 1])
        level[np.abs(apart[..., 2]) >= HEIGHT_GATE_M] = np.inf
        nearest = level.argmin(axis=1)
        for i, j in enumerate(nearest.tolist()):
            if level[i, j] < gate_m and level[:, j].argmin() == i:
                one, other = (a, int(columns[a][i])), (b, int(columns[b][j]))
                links.append((float(level[i, j]), one, other))
    groups: dict[tuple[int, int], dict[int, int]] = {}
    for _, one, other in sorted(links):
        first = groups.get(one, {one[0]: one[1]})
        second = groups.get(other, {other[0]: other[1]})
        if first is not second and not first.keys() & second.keys():
            joined = {**first, **second}
            groups |= dict.fromkeys(joined.items(), joined)
    return list({id(group): group for group in groups.values()}.values())
