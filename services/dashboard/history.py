"""The last seconds of what viewers were sent, in bounded memory."""

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Set
from dataclasses import dataclass

NEAR_MS = 2000.0  # of a time before which a packet no longer shows it


@dataclass(frozen=True, slots=True)
class Packet:
    """Parts that are sent together, by kind, each encoded once for all viewers."""

    at_ms: float  # [ms] wall clock when it was made
    # a newer packet of the same key replaces one that still waits; empty: all are sent
    key: str
    parts: tuple[tuple[str, bytes], ...]  # kind and bytes
    stamp_ns: int = 0  # of the frame that it belongs to; 0: of none

    @property
    def follows(self) -> bool:
        """True for what comes after its frame, and is shown with that frame only."""
        return self.parts[0][0] == "skeletons"

    @property
    def size(self) -> int:
        """Number of bytes."""
        return sum(len(data) for _, data in self.parts)


class History:
    """Packets of the last seconds.

    Args:
        seconds: Age of the oldest.
        max_bytes: Size of all.
    """

    def __init__(self, seconds: float, max_bytes: int) -> None:
        self._milliseconds, self._max_bytes = seconds * 1000, max_bytes
        self._packets: deque[Packet] = deque()
        self._size = 0

    @property
    def size(self) -> int:
        """Number of bytes of all packets."""
        return self._size

    @property
    def begin_ms(self) -> float | None:
        """Time of the oldest packet; None if there is none."""
        return self._packets[0].at_ms if self._packets else None

    def add(self, packet: Packet) -> None:
        """Add the newest packet; the oldest make room."""
        if self._packets and packet.at_ms < self._packets[-1].at_ms:  # the clock was set back
            self._packets.clear()
            self._size = 0
        self._packets.append(packet)
        self._size += packet.size
        while self._packets and (
            self._size > self._max_bytes
            or packet.at_ms - self._packets[0].at_ms > self._milliseconds
        ):
            self._size -= self._packets.popleft().size

    def at(self, at_ms: float, kinds: Set[str] = frozenset()) -> list[Packet]:
        """Return the newest packet of each key at a time, and what belongs to their frames.

        Args:
            at_ms: The time.
            kinds: Parts of a frame; older frames that have all of them are preferred.
        """
        times = [packet.at_ms for packet in self._packets]
        begin, end = bisect_left(times, at_ms - NEAR_MS), bisect_right(times, at_ms)
        near = [self._packets[index] for index in range(begin, end)]
        near.sort(key=lambda packet: len(kinds & dict(packet.parts).keys()))  # stable
        found = {packet.key: packet for packet in near if not packet.follows}
        stamps = {packet.stamp_ns for packet in found.values() if packet.stamp_ns}
        last = bisect_right(times, at_ms + NEAR_MS)
        following = (self._packets[index] for index in range(begin, last))
        found |= {p.key: p for p in following if p.follows and p.stamp_ns in stamps}
        return sorted(found.values(), key=lambda packet: packet.at_ms)
