"""History of the last seconds of packets, in bounded memory."""

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Set
from dataclasses import dataclass

NEAR_MS = 2000.0  # maximum age of a packet at the shown time [ms]


@dataclass(frozen=True, slots=True)
class Packet:
    """Encoded parts that are sent together to all viewers."""

    at_ms: float  # time of creation by the wall clock [ms]
    key: str  # key; a newer packet replaces a waiting one of the same key
    parts: tuple[tuple[str, bytes], ...]  # kind and bytes of each part
    stamp_ns: int = 0  # stamp of the frame; 0: without a frame

    @property
    def follows(self) -> bool:
        """True for a packet that arrives after its frame, and belongs to that frame only."""
        return self.parts[0][0] == "skeletons"

    @property
    def size(self) -> int:
        """Number of bytes."""
        return sum(len(data) for _, data in self.parts)


class History:
    """Packets of the last seconds.

    Args:
        seconds: Maximum age of a packet.
        max_bytes: Maximum size of all packets.
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

    def add_packet(self, packet: Packet) -> None:
        """Add the newest packet; delete the oldest beyond the limits."""
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

    def packets_at(self, at_ms: float, kinds: Set[str] = frozenset()) -> list[Packet]:
        """Return the newest packet of each key at a time, and packets of their frames.

        Args:
            at_ms: The time [ms].
            kinds: Parts of a frame; older frames with all of them are preferred.
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
