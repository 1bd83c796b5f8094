"""What the tracks of the last seconds say of the truth's clock and frame."""

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, Literal

import numpy as np

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import apply
from common.metrics import (
    ClockOffset,
    SpaceAlignment,
    TruthBuffer,
    estimate_clock,
    estimate_motion,
    trajectories_of,
)
from common.metrics.alignment.trajectories import Trajectory
from people4d.messages import F64, Alignment, Tracks
from services.gt_bridge.config import GtBridgeConfig

EVERY_NS = 5 * 10**9  # from one estimate to the next, in stamps
THIN_NS = 50_000_000  # more tracks tell little more
TRACKS = 300  # messages that an estimate rests on, 15 s
DIMENSIONS: Mapping[str, Literal[2, 3]] = {"2d": 2, "3d": 3}


class Aligner:
    """Estimates the alignment every few seconds, if that is asked for.

    Args:
        config: What is looked for, and whether it is applied.
    """

    def __init__(self, config: GtBridgeConfig) -> None:
        self._config = config
        self._wanted = config.align_clock_s > 0 or config.align_space != "off"
        self.restart()

    def restart(self) -> None:
        """Forget everything."""
        self._tracks: deque[Tracks] = deque(maxlen=TRACKS)
        self._next_ns: int | None = None
        self.found: Alignment | None = Alignment(applied=False) if self._wanted else None

    @property
    def offset_ns(self) -> int:
        """What to add to stamps of the truth, as far as that is to be applied."""
        offset_s = self.found.clock_offset_s if self.found and self.found.applied else None
        return round((offset_s or 0.0) * 1e9)

    @property
    def matrix(self) -> F64:
        """Motion of the truth (4x4) in the frame of the tracks, as far as it is to be applied."""
        matrix = self.found.matrix if self.found and self.found.applied else None
        return np.eye(4) if matrix is None else matrix

    def observe(self, tracks: Tracks, trail: TruthBuffer, frames: TransformBuffer) -> None:
        """Take tracks whose truth is there; now and then estimate anew."""
        if not self._wanted:
            return
        if not self._tracks or tracks.stamp_ns - self._tracks[-1].stamp_ns >= THIN_NS:
            self._tracks.append(tracks)
        self._next_ns = self._next_ns or tracks.stamp_ns + EVERY_NS
        if tracks.stamp_ns >= self._next_ns:
            self._next_ns = tracks.stamp_ns + EVERY_NS
            self._estimate(trail, frames, tracks.frame_id)

    def _estimate(self, trail: TruthBuffer, frames: TransformBuffer, frame_id: str) -> None:
        start_ns = self._tracks[0].stamp_ns
        told = (
            (track.id, tracks.stamp_ns, track.position_m)
            for tracks in self._tracks
            for track in tracks.tracks
            if track.state == "confirmed"
        )
        truth = trajectories_of(_placed(trail, frames, frame_id, start_ns - EVERY_NS), start_ns)
        clock, motion = self._solve(truth, trajectories_of(told, start_ns))
        self.found = Alignment(
            applied=self._config.apply_alignment and (clock is not None or motion is not None),
            clock_offset_s=clock.offset_s if clock else None,
            clock_sigma_s=clock.sigma_s if clock else None,
            matrix=motion.matrix if motion else None,
            rmse_before_m=motion.rmse_before_m if motion else None,
            rmse_after_m=motion.rmse_after_m if motion else None,
        )

    def _solve(
        self, truth: Mapping[Any, Trajectory], tracked: Mapping[Any, Trajectory]
    ) -> tuple[ClockOffset | None, SpaceAlignment | None]:
        """Find the clock, then the motion, and both once more: each is better with the other."""
        clock, motion, widest_s = None, None, self._config.align_clock_s
        dimensions = DIMENSIONS.get(self._config.align_space)
        for _ in range(2):
            if widest_s:
                placed = _moved(truth, motion.matrix) if motion else truth
                clock = estimate_clock(placed, tracked, widest_s)
            if dimensions:
                offset_s = clock.offset_s if clock else 0.0
                motion = estimate_motion(truth, tracked, offset_s, dimensions)
        return clock, motion


def _moved(paths: Mapping[Any, Trajectory], matrix: F64) -> dict[Any, Trajectory]:
    return {
        k: Trajectory(path.stamps_s, apply(matrix, path.positions_m)) for k, path in paths.items()
    }


def _placed(
    trail: TruthBuffer, frames: TransformBuffer, frame_id: str, since_ns: int
) -> Iterator[tuple[str, int, F64]]:
    """Yield identity, stamp and position of people in the frame of the tracks."""
    last_ns = since_ns
    for truth in trail.messages:
        place = frames.lookup(frame_id, truth.frame_id, truth.stamp_ns)
        # Paths need rising stamps, and captures may have the same stamp twice.
        if truth.stamp_ns > last_ns and place is not None:
            last_ns = truth.stamp_ns
            for person in {person.id: person for person in truth.people}.values():
                yield person.id, truth.stamp_ns, apply(place.matrix, person.position_m)
