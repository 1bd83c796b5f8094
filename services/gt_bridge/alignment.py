"""Estimation of clock offset and rigid motion of the truth from recent tracks."""

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, Literal

from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transforms import apply
from common.metrics.alignment.alignment import (
    ClockOffset,
    SpaceAlignment,
    estimate_clock,
    estimate_motion,
)
from common.metrics.alignment.trajectories import Trajectory, trajectories_of
from common.metrics.alignment.truth_buffer import TruthBuffer
from common.metrics.live import TruthAlignment
from people4d.messages import F64, Alignment, Tracks
from services.gt_bridge.config import GtBridgeConfig

PERIOD_NS = 5 * 10**9  # time between estimates, in stamps [ns]
SAMPLE_NS = 50_000_000  # minimum time between used tracks [ns]
MAX_TRACKS = 300  # maximum number of messages in an estimate, 15 s
DIMENSIONS: Mapping[str, Literal[2, 3]] = {"2d": 2, "3d": 3}


class EstimatedAlignment(TruthAlignment):
    """Alignment estimated every few seconds, as configured."""

    def __init__(self, config: GtBridgeConfig, transforms: TransformBuffer) -> None:
        self._config, self._transforms = config, transforms
        self.restart()

    def restart(self) -> None:
        """Delete all observations."""
        self._tracks: deque[Tracks] = deque(maxlen=MAX_TRACKS)
        self._next_ns: int | None = None
        self._set(None, None)

    def observe(self, tracks: Tracks, truth: TruthBuffer) -> None:
        """Add tracks with truth; update the estimate every few seconds."""
        if not self._tracks or tracks.stamp_ns - self._tracks[-1].stamp_ns >= SAMPLE_NS:
            self._tracks.append(tracks)
        self._next_ns = self._next_ns or tracks.stamp_ns + PERIOD_NS
        if tracks.stamp_ns >= self._next_ns:
            self._next_ns = tracks.stamp_ns + PERIOD_NS
            self._estimate(truth, tracks.frame_id)

    def _estimate(self, truth: TruthBuffer, frame_id: str) -> None:
        start_ns = self._tracks[0].stamp_ns
        tracked = (
            (track.id, tracks.stamp_ns, track.position_m)
            for tracks in self._tracks
            for track in tracks.tracks
            if track.state == "confirmed"
        )
        people = self._positions(truth, frame_id, start_ns - PERIOD_NS)
        truths, tracks = trajectories_of(people, start_ns), trajectories_of(tracked, start_ns)
        self._set(*self._solve(truths, tracks))

    def _set(self, clock: ClockOffset | None, motion: SpaceAlignment | None) -> None:
        applied = self._config.apply_alignment and (clock is not None or motion is not None)
        self.estimate = Alignment(
            applied=applied,
            clock_offset_s=clock.offset_s if clock else None,
            clock_sigma_s=clock.sigma_s if clock else None,
            matrix=motion.matrix if motion else None,
            rmse_before_m=motion.rmse_before_m if motion else None,
            rmse_after_m=motion.rmse_after_m if motion else None,
        )
        self.offset_ns = round(clock.offset_s * 1e9) if applied and clock else 0
        self.matrix = motion.matrix if applied and motion else None

    def _solve(
        self, truth: Mapping[Any, Trajectory], tracked: Mapping[Any, Trajectory]
    ) -> tuple[ClockOffset | None, SpaceAlignment | None]:
        """Estimate clock and motion alternately, twice: each improves the other."""
        clock, motion, widest_s = None, None, self._config.align_clock_s
        dimensions = DIMENSIONS.get(self._config.align_space)
        for _ in range(2):
            if widest_s:
                aligned = _transformed(truth, motion.matrix) if motion else truth
                clock = estimate_clock(aligned, tracked, widest_s)
            if dimensions:
                offset_s = clock.offset_s if clock else 0.0
                motion = estimate_motion(truth, tracked, offset_s, dimensions)
        return clock, motion

    def _positions(
        self, truth: TruthBuffer, frame_id: str, since_ns: int
    ) -> Iterator[tuple[str, int, F64]]:
        """Yield identity, stamp and position of people in the frame of the tracks."""
        last_ns = since_ns
        for message in truth.messages:
            pose = self._transforms.lookup(frame_id, message.frame_id, message.stamp_ns)
            # Trajectories need rising stamps, and a capture may repeat a stamp.
            if message.stamp_ns > last_ns and pose is not None:
                last_ns = message.stamp_ns
                for person in {person.id: person for person in message.people}.values():
                    yield person.id, message.stamp_ns, apply(pose.matrix, person.position_m)


def _transformed(trajectories: Mapping[Any, Trajectory], matrix: F64) -> dict[Any, Trajectory]:
    return {
        key: Trajectory(path.stamps_s, apply(matrix, path.positions_m))
        for key, path in trajectories.items()
    }
