"""Truth interpolated between its samples: positions along a line, angles along the shorter arc."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from operator import attrgetter

import msgspec

from common.geometry.transforms import wrap
from people4d.messages import F64, Truth, TruthPerson

MAX_GAP_NS = 200_000_000  # [ns] maximum interpolated gap: people move 0.3 m in this time
STAMP = attrgetter("stamp_ns")
CAPACITY = 2048  # number of stored messages: 20 s at 100 Hz


class TruthBuffer:
    """Truth of the last messages (`capacity`) at any stamp; short gaps are interpolated."""

    def __init__(self, max_gap_ns: int = MAX_GAP_NS, capacity: int = CAPACITY) -> None:
        self._max_gap_ns, self._capacity = max_gap_ns, capacity
        self.messages: list[Truth] = []  # oldest first

    def add_truth(self, truth: Truth) -> None:
        """Add a message; a message older than the last one clears the buffer."""
        if self.messages and truth.stamp_ns < self.messages[-1].stamp_ns:
            self.messages.clear()
        self.messages.append(truth)
        if len(self.messages) >= 2 * self._capacity:  # rarely: the front of a list is slow
            del self.messages[: self._capacity]

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the last message, None if there is none."""
        return self.messages[-1].stamp_ns if self.messages else None

    def at(self, stamp_ns: int) -> Truth | None:
        """Return the people captured shortly before and after a stamp; None without both sides."""
        gap_ns = self._max_gap_ns
        before = self._between(stamp_ns - gap_ns, stamp_ns)
        after = self._between(stamp_ns, stamp_ns + gap_ns)
        if not before or not after or after[0].stamp_ns - before[-1].stamp_ns > gap_ns:
            return None
        earlier, later = _nearest(reversed(before), before[-1]), _nearest(after, before[-1])
        people = tuple(
            _interpolate(person, later[name][1], _share_of(start_ns, stamp_ns, later[name][0]))
            for name, (start_ns, person) in earlier.items()
            if name in later and later[name][0] - start_ns <= gap_ns
        )
        return msgspec.structs.replace(before[-1], stamp_ns=stamp_ns, people=people)

    def _between(self, first_ns: int, last_ns: int) -> list[Truth]:
        start = bisect_left(self.messages, first_ns, key=STAMP)
        return self.messages[start : bisect_right(self.messages, last_ns, key=STAMP)]


def _share_of(start_ns: int, stamp_ns: int, end_ns: int) -> float:
    """Return the elapsed share of an interval at a stamp, 0 to 1; 0 if it is empty."""
    return (stamp_ns - start_ns) / (end_ns - start_ns) if end_ns > start_ns else 0.0


def _nearest(messages: Iterable[Truth], like: Truth) -> dict[str, tuple[int, TruthPerson]]:
    """Return each person's first appearance with its stamp, among messages of one frame."""
    found: dict[str, tuple[int, TruthPerson]] = {}
    for message in messages:
        if message.frame_id == like.frame_id:
            for person in message.people:
                found.setdefault(person.id, (message.stamp_ns, person))
    return found


def _interpolate(a: TruthPerson, b: TruthPerson, share: float) -> TruthPerson:
    return TruthPerson(
        id=a.id,
        position_m=a.position_m + share * (b.position_m - a.position_m),
        velocity_mps=_line(a.velocity_mps, b.velocity_mps, share),
        yaw_rad=_arc(a.yaw_rad, b.yaw_rad, share),
        path_yaw_rad=_arc(a.path_yaw_rad, b.path_yaw_rad, share),
    )


def _line(a: F64 | None, b: F64 | None, share: float) -> F64 | None:
    return None if a is None or b is None else a + share * (b - a)


def _arc(a_rad: float | None, b_rad: float | None, share: float) -> float | None:
    if a_rad is None or b_rad is None:
        return None
    return wrap(a_rad + share * wrap(b_rad - a_rad))
