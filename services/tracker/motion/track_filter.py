"""The filters of a track's state and of its yaw, applied to tracks together."""

from collections.abc import Sequence

from people4d.messages import F64
from services.tracker.interface import Measurement
from services.tracker.motion.state_filter import FilterState, StateFilter
from services.tracker.motion.track_record import TrackRecord
from services.tracker.motion.yaw import VelocityYaw

Filtered = list[tuple[FilterState, F64 | None]]


class TrackFilter:
    """Predicts and updates states and yaws of tracks.

    Args:
        state: Filter of the states.
        yaw: Filter of the yaws.
    """

    def __init__(self, state: StateFilter, yaw: VelocityYaw) -> None:
        self._state, self._yaw = state, yaw

    def predicted(
        self, records: Sequence[TrackRecord], dt_s: float, noise_factor: float = 1.0
    ) -> Filtered:
        """Return states and yaws of tracks dt_s seconds later, see `PositionMotion.predict`."""
        states = self._state.predict(records, dt_s, noise_factor)
        yaws = self._yaw.predict([t.yaw for t in records], dt_s)
        return list(zip(states, yaws, strict=True))

    def predict(
        self, records: Sequence[TrackRecord], dt_s: float, noise_factor: float = 1.0
    ) -> None:
        """Move tracks ahead by dt_s seconds."""
        _set(records, self.predicted(records, dt_s, noise_factor))

    def update(
        self, records: Sequence[TrackRecord], measurements: Sequence[Measurement], z: F64, R: F64
    ) -> None:
        """Update tracks with one measurement (Nx3, noise Nx3x3) each."""
        states = self._state.update(records, z, R)
        yaws = self._yaw.update([t.yaw for t in records], measurements)
        _set(records, list(zip(states, yaws, strict=True)))


def _set(records: Sequence[TrackRecord], filtered: Filtered) -> None:
    for record, (state, yaw) in zip(records, filtered, strict=True):
        (record.x, record.P, record.imm), record.yaw = state, yaw
