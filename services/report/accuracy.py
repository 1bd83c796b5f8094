"""How far tracks are from the truth (method book section 9)."""

from collections import deque
from collections.abc import Sequence

import msgspec
import numpy as np
from scipy.optimize import linear_sum_assignment

from common.metrics.alignment.truth_buffer import TruthBuffer
from common.metrics.pose import rmse
from people4d.messages import F64, Track, Tracks, Truth, TruthPerson
from services.report.spread import EvenSample

GATE_M = 1.0  # a track farther from the truth is not that person
SAMPLES = 10_000


class Accuracy(msgspec.Struct, frozen=True, kw_only=True):
    """Confirmed tracks against the truth, over all frames that have both."""

    frames: int  # compared
    truth_people: int  # people in the truth of those frames
    matched: int  # of them matched to a track within 1 m, at most one each
    extra: int  # tracks matched to nobody
    position_median_m: float | None  # [m] horizontal distance of the matched
    position_rmse_m: float | None  # [m] likewise
    velocity_rmse_mps: float | None  # [m/s] horizontal; absent if the truth has no velocity
    id_switches: int  # times that a person was matched to another track than the last time


class TruthCheck:
    """Compares tracks with truth interpolated to their stamp, as soon as both are there."""

    def __init__(self) -> None:
        self._truth = TruthBuffer()
        self._waiting: deque[Tracks] = deque(maxlen=512)
        self._position_m: EvenSample[float] = EvenSample(SAMPLES)
        self._velocity_mps: EvenSample[float] = EvenSample(SAMPLES)
        self._last_track: dict[str, int] = {}
        self._frames = self._people = self._matched = self._extra = self._switches = 0

    def add(self, message: Tracks | Truth) -> None:
        """Take a message; either stream may be ahead."""
        if isinstance(message, Tracks):
            self._waiting.append(message)
        else:
            newest_ns = self._truth.newest_ns
            if newest_ns is not None and message.stamp_ns < newest_ns:
                self._waiting.clear()  # playback began again
            self._truth.add(message)
        while self._waiting and self._is_due(self._waiting[0]):
            self._compare(self._waiting.popleft())

    def result(self) -> Accuracy | None:
        """Return the figures, None where nothing could be compared."""
        if not self._frames:
            return None
        position_m = np.array(self._position_m.values)
        velocity_mps = np.array(self._velocity_mps.values)
        return Accuracy(
            frames=self._frames,
            truth_people=self._people,
            matched=self._matched,
            extra=self._extra,
            position_median_m=float(np.median(position_m)) if len(position_m) else None,
            position_rmse_m=rmse(position_m),
            velocity_rmse_mps=rmse(velocity_mps),
            id_switches=self._switches,
        )

    def _is_due(self, tracks: Tracks) -> bool:
        newest_ns = self._truth.newest_ns
        return newest_ns is not None and newest_ns >= tracks.stamp_ns

    def _compare(self, tracks: Tracks) -> None:
        truth = self._truth.at(tracks.stamp_ns)
        if truth is None or truth.frame_id != tracks.frame_id:
            return
        people = [track for track in tracks.tracks if track.state == "confirmed"]
        pairs = match(truth.people, people)
        self._frames += 1
        self._people += len(truth.people)
        self._matched += len(pairs)
        self._extra += len(people) - len(pairs)
        for i, j in pairs:
            self._compare_person(truth.people[i], people[j])

    def _compare_person(self, person: TruthPerson, track: Track) -> None:
        self._position_m.add(_distance(person.position_m, track.position_m))
        if person.velocity_mps is not None:
            self._velocity_mps.add(_distance(person.velocity_mps, track.velocity_mps))
        self._switches += self._last_track.get(person.id, track.id) != track.id
        self._last_track[person.id] = track.id


def match(people: Sequence[TruthPerson], tracks: Sequence[Track]) -> list[tuple[int, int]]:
    """Return the pairs (person, track) within the gate with the least sum of distances."""
    if not people or not tracks:
        return []
    truth = np.array([person.position_m[:2] for person in people])
    found = np.array([track.position_m[:2] for track in tracks])
    distance = np.linalg.norm(truth[:, None] - found[None], axis=2)
    # Beyond the gate all pairs cost the same, so that they never displace one within it.
    rows, columns = linear_sum_assignment(np.minimum(distance, GATE_M))
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if distance[i, j] < GATE_M]


def _distance(a: F64, b: F64) -> float:
    return float(np.linalg.norm(a[:2] - b[:2]))
