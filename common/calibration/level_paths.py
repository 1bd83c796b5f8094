"""Paths of people in one camera in level axes, by time, and between the steps of the grid."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from common.calibration.tracklets import LIMBS_COUNT, STEP_S, Tracklet
from people4d.messages import F64, CameraInfo

BOOL = npt.NDArray[np.bool_]
MARGIN = 0.1  # border in which detections may be missing, relative to the image's side
# Depth range of reliable detections: minimum [m], and maximum relative to max_depth
NEAR_M, FAR_SHARE = 1.2, 0.8


@dataclass(frozen=True)
class LevelPaths:
    """Paths of one camera in axes x forward, y left, z up, by grid step."""

    camera: str
    level_from_optical: F64  # 3x3
    info: CameraInfo | None
    paths: Sequence[Tracklet]

    @cached_property
    def first(self) -> int:
        """First grid step."""
        return min((p.first for p in self.paths), default=0)

    @cached_property
    def _arrays(self) -> tuple[F64, F64, F64]:
        last = max((p.last for p in self.paths), default=self.first)
        rows: list[int] = []  # first free step of each column
        columns: list[int] = []
        for path in sorted(self.paths, key=lambda p: p.first):
            free = next((k for k, end in enumerate(rows) if end < path.first), len(rows))
            rows[free : free + 1] = [path.last]
            columns.append(free)
        shape = (last - self.first, max(len(rows), 1), 3)
        positions, velocities = np.full(shape, np.nan), np.full(shape, np.nan)
        limbs = np.full((*shape[:2], LIMBS_COUNT, 2), np.nan)
        turn = self.level_from_optical.T
        for path, column in zip(sorted(self.paths, key=lambda p: p.first), columns, strict=True):
            steps = slice(path.first - self.first, path.last - self.first)
            positions[steps, column] = path.positions_m @ turn
            velocities[steps, column] = path.velocities_mps @ turn
            if path.limbs is not None:
                limbs[steps, column] = path.limbs
        return positions, velocities, limbs

    @property
    def positions_m(self) -> F64:
        """Positions, TxKx3, NaN for absent people."""
        return self._arrays[0]

    @property
    def velocities_mps(self) -> F64:
        """Velocities, TxKx3."""
        return self._arrays[1]

    def between(self, share: float) -> tuple[F64, F64]:
        """Return positions and velocities (TxKx3) a share of a step later, by cubics."""
        (p, v, _), s = self._arrays, share
        p1, v1 = np.full_like(p, np.nan), np.full_like(v, np.nan)
        p1[:-1], v1[:-1] = p[1:], v[1:]
        rise = p1 - p
        start, end = STEP_S * v - rise, rise - STEP_S * v1
        position = (1 - s) * p + s * p1 + s * (1 - s) * ((1 - s) * start + s * end)
        velocity = rise + (1 - s) * (1 - 3 * s) * start + s * (2 - 3 * s) * end
        return position, velocity / STEP_S

    def limbs_between(self, share: float) -> F64:
        """Return the rays of joints (TxKxJx2, optical frame) a share of a step later."""
        limbs = self._arrays[2]
        between = np.full_like(limbs, np.nan)
        between[:-1] = (1 - share) * limbs[:-1] + share * limbs[1:]
        return between

    def in_view(self, points_m: F64) -> BOOL:
        """Check that points (...x3) are in the region of reliable detections of this camera."""
        if self.info is None:
            return np.zeros(points_m.shape[:-1], np.bool_)
        optical = points_m @ self.level_from_optical
        info, z = self.info, optical[..., 2]
        with np.errstate(all="ignore"):
            u = optical[..., 0] / z * info.fx + info.cx
            v = optical[..., 1] / z * info.fy + info.cy
        inside = (u > MARGIN * info.width) & (u < (1 - MARGIN) * info.width)
        inside &= (v > MARGIN * info.height) & (v < (1 - MARGIN) * info.height)
        return np.asarray(inside & (z > NEAR_M) & (z < FAR_SHARE * info.max_depth_m))
