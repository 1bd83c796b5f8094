"""Frames of the last second, for tracking a late frame at its own time.

Tracks return to their states before the late frame, the frame is tracked, and later matches are
filtered again. Source: docs/method.md, section 3.
"""

from bisect import insort
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from people4d.messages import F64
from services.tracker.interface import LATE_MAX_NS, Measurement, Observation
from services.tracker.motion.state_filter import FilterState
from services.tracker.motion.track_filter import TrackFilter
from services.tracker.motion.track_record import TrackRecord

LASTS_MAX_S = 0.2  # maximum duration of an acceleration between frames of several cameras [s]


class PastMatch(NamedTuple):
    """Measurement of an update of a track."""

    measurement: Measurement
    z: F64
    R: F64


class PastState(NamedTuple):
    """State of a track after a frame."""

    record: TrackRecord  # present record of the track
    state: FilterState
    yaw: F64 | None
    matched_ns: int


@dataclass(slots=True)
class PastFrame:
    """All tracks after a frame, by address of their records."""

    stamp_ns: int
    camera: str
    states: dict[int, PastState]
    matches: dict[int, PastMatch]


class PastFrames:
    """The last frames of a tracker.

    Args:
        track_filter: Filters of the tracker.
    """

    def __init__(self, track_filter: TrackFilter) -> None:
        self._filter = track_filter
        self._frames: list[PastFrame] = []  # frames in the order of their times
        self._matches: dict[int, PastMatch] = {}  # matches of the current frame
        self._present: dict[int, TrackRecord] = {}  # present records during a late frame

    def clear(self) -> None:
        """Delete all frames."""
        self._frames.clear()
        self._matches.clear()
        self._present.clear()

    def add_match(self, record: TrackRecord, match: PastMatch) -> None:
        """Store a match of the current frame."""
        self._matches[id(record)] = match

    def add_frame(self, records: Sequence[TrackRecord], observation: Observation) -> None:
        """Store the tracks after the current frame."""
        states = {  # arrays of a state are replaced, never changed
            id(t): PastState(t, FilterState(t.x, t.P, t.imm), t.yaw, t.matched_ns) for t in records
        }
        frame = PastFrame(observation.stamp_ns, observation.camera, states, self._matches)
        self._matches = {}
        insort(self._frames, frame, key=lambda f: f.stamp_ns)
        newest_ns = self._frames[-1].stamp_ns
        while self._frames[0].stamp_ns < newest_ns - LATE_MAX_NS:
            del self._frames[0]

    def noise_factor(self, observation: Observation, dt_s: float) -> float:
        """Return the factor of the process noise, dt_s seconds after the previous frame.

        An acceleration lasts for the frame interval of one camera. The shorter interval between
        frames of several cameras would underestimate the noise.
        """
        before_ns = self._stamps_before(observation.stamp_ns).get(observation.camera)
        return _noise_factor(observation.stamp_ns, before_ns, dt_s)

    def go_back(self, records: Sequence[TrackRecord], stamp_ns: int) -> int:
        """Set tracks to their states after the last frame before a time; return its stamp [ns].

        A track that began later gets its initial state.
        """
        self._present = {id(t): replace(t) for t in records}
        before = [frame for frame in self._frames if frame.stamp_ns <= stamp_ns]
        later = [frame for frame in self._frames if frame.stamp_ns > stamp_ns]
        for record in records:
            frames = (*before[-1:], *later)
            found = next((f.states[id(record)] for f in frames if id(record) in f.states), None)
            if found:
                (record.x, record.P, record.imm), record.yaw = found.state, found.yaw
                record.matched_ns = found.matched_ns
        return before[-1].stamp_ns if before else stamp_ns

    def go_forward(self, records: Sequence[TrackRecord], stamp_ns: int) -> None:
        """Return tracks to the present, with all measurements since a time."""
        present, self._present = self._present, {}
        later = [frame for frame in self._frames if frame.stamp_ns > stamp_ns]
        changed = [t for t in records if _is_changed(t, present, later)]
        self._filter_again(changed, stamp_ns, later)
        is_changed = {id(t) for t in changed}
        for record in records:
            before = present.get(id(record))
            if before and id(record) not in is_changed:
                record.x, record.P, record.imm = before.x, before.P, before.imm
                record.yaw = before.yaw
            if before and before.matched_ns > record.matched_ns:
                record.matched_ns, record.camera = before.matched_ns, before.camera
                record.missed, record.score = before.missed, before.score
            # Missed time counts from the newest match, not from the late one.
            record.missed_since_ns = max(record.missed_since_ns, record.matched_ns)

    def _stamps_before(self, stamp_ns: int) -> dict[str, int]:
        """Return the stamps of the last frames before a time, by camera."""
        return {f.camera: f.stamp_ns for f in self._frames if f.stamp_ns < stamp_ns}

    def _filter_again(
        self, records: Sequence[TrackRecord], stamp_ns: int, later: Sequence[PastFrame]
    ) -> None:
        if not records:
            return
        before_ns = self._stamps_before(later[0].stamp_ns) if later else {}
        for frame in later:
            dt_s = (frame.stamp_ns - stamp_ns) / 1e9
            factor = _noise_factor(frame.stamp_ns, before_ns.get(frame.camera), dt_s)
            self._filter.predict(records, dt_s, factor)
            matched = [t for t in records if id(t) in frame.matches]
            self._update(matched, [frame.matches[id(t)] for t in matched])
            for t in records:
                before = frame.states.get(id(t))
                matched_ns = max(t.matched_ns, before.matched_ns if before else 0)
                state = FilterState(t.x, t.P, t.imm)
                frame.states[id(t)] = PastState(t, state, t.yaw, matched_ns)
            stamp_ns = before_ns[frame.camera] = frame.stamp_ns

    def _update(self, records: Sequence[TrackRecord], matches: Sequence[PastMatch]) -> None:
        if not records:
            return
        z, R = np.array([m.z for m in matches]), np.array([m.R for m in matches])
        self._filter.update(records, [match.measurement for match in matches], z, R)


def _noise_factor(stamp_ns: int, before_ns: int | None, dt_s: float) -> float:
    """Return the factor of the process noise, given the previous frame of the same camera."""
    if before_ns is None or dt_s <= 0:
        return 1.0
    return max(min((stamp_ns - before_ns) / 1e9, LASTS_MAX_S) / dt_s, 1.0)


def _is_changed(
    record: TrackRecord, present: dict[int, TrackRecord], later: Sequence[PastFrame]
) -> bool:
    """Return True for a track that the late frame began or updated."""
    if id(record) not in present:
        return True
    began_later = bool(later) and id(record) not in later[0].states
    return record.detection is not None and not began_later
