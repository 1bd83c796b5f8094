"""Trajectories of a camera as text, and their errors as in the TUM RGB-D benchmark."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from common.geometry.transforms import invert
from common.io.files import read_text
from common.metrics.counts import Counts
from common.metrics.scores import Row
from people4d.errors import SourceError
from people4d.messages import F64

NEAR_S = 0.02  # [s] maximum distance in time of a pose from its truth; associate.py
STEP_S = 1.0  # [s] length of a relative motion; the benchmark's online evaluation
MAX_BYTES = 2**26
Poses = Mapping[float, F64]  # camera in the world (4x4) by time [s]


@dataclass(frozen=True)
class TrajectoryErrors(Counts):
    """Sums of squared errors of a trajectory."""

    poses: int = 0
    position_m2: float = 0.0  # after rigid alignment
    motions: int = 0
    motion_m2: float = 0.0  # drift in STEP_S
    motion_rad2: float = 0.0

    def row(self) -> Row:
        """Return the root mean squares."""
        sums = {
            "ate_rmse_m": (self.position_m2, self.poses),
            "rpe_rmse_m": (self.motion_m2, self.motions),
            "rpe_rmse_rad": (self.motion_rad2, self.motions),
        }
        return {name: float(np.sqrt(part / n)) if n else None for name, (part, n) in sums.items()}


def read_poses(path: Path) -> dict[float, F64]:
    """Read a trajectory; SourceError if it cannot be read, or a line has other columns."""
    poses = {}
    try:
        for number, line in enumerate(read_text(path, MAX_BYTES).splitlines(), 1):
            words = line.partition("#")[0].split()
            if words:
                values = np.array(words, np.float64)
                if len(values) != 8 or not np.isfinite(values).all():
                    raise ValueError(f"line {number}: expected 8 numbers, got {line!r:.60}")
                poses[float(values[0])] = pose = np.eye(4)
                pose[:3, :3] = Rotation.from_quat(values[4:]).as_matrix()
                pose[:3, 3] = values[1:4]
        if len(poses) < 2:
            raise ValueError(f"expected two poses or more, got {len(poses)}")
    except (OSError, ValueError) as error:
        raise SourceError(f"{path}: {error}") from error
    return poses


def trajectory(poses: Poses) -> str:
    """Return a trajectory as the benchmark expects it."""
    lines = []
    for time_s, pose in poses.items():
        values = [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
        lines.append(f"{time_s:.6f} {' '.join(f'{x:.6f}' for x in values)}\n")
    return "".join(lines)


def score(poses: Poses, truth: Poses) -> TrajectoryErrors:
    """Compare a trajectory with its truth at the nearest times."""
    known_s, times_s = np.array(sorted(truth)), np.array(sorted(poses))
    if not len(times_s):
        return TrajectoryErrors()
    nearest = [int(np.abs(known_s - time_s).argmin()) for time_s in times_s]
    near = np.abs(known_s[nearest] - times_s)
    pairs = [(poses[t], truth[known_s[k]]) for t, k in zip(times_s, nearest, strict=True)]
    close = [pair for pair, apart_s in zip(pairs, near, strict=True) if apart_s < NEAR_S]
    motions, limit_s = [], 2 * float(np.median(np.diff(known_s)))
    for first, time_s in enumerate(times_s):
        last = int(np.abs(times_s - time_s - STEP_S).argmin())
        if last < len(times_s) - 1 and max(near[first], near[last]) <= limit_s:
            (a, true_a), (b, true_b) = pairs[first], pairs[last]
            motions.append(invert(invert(b) @ a) @ (invert(true_b) @ true_a))
    drifts = np.array(motions).reshape(-1, 4, 4)
    return TrajectoryErrors(
        poses=len(close),
        position_m2=_aligned_m2(*np.array(close)[..., :3, 3].swapaxes(0, 1)) if close else 0.0,
        motions=len(motions),
        motion_m2=float((drifts[:, :3, 3] ** 2).sum()),
        motion_rad2=float((Rotation.from_matrix(drifts[:, :3, :3]).magnitude() ** 2).sum())
        if motions
        else 0.0,
    )


def _aligned_m2(points_m: F64, truth_m: F64) -> float:
    """Return the sum of squared distances after rigid alignment [Horn 1987]."""
    a, b = points_m - points_m.mean(axis=0), truth_m - truth_m.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    flip = np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)])
    return float(((b - a @ (u @ flip @ vt).T) ** 2).sum())
