"""Totals of the last seconds and of all frames, in bounded memory."""

from collections import Counter, deque

from common.metrics.frame_scores import ScoreTotals
from people4d.messages import Tally

RECENT_NS = 10 * 10**9
MAX_RECENT = 1024  # frames: 10 s at 100 frames a second


class RunningTotals:
    """Totals of the last 10 s and of all frames."""

    def __init__(self) -> None:
        self._window: deque[tuple[int, ScoreTotals]] = deque(maxlen=MAX_RECENT)
        self._total = ScoreTotals()
        self._first_ns = self._last_ns = 0

    def add(self, stamp_ns: int, totals: ScoreTotals) -> None:
        """Add one frame."""
        self._first_ns = self._first_ns if self._total.frames else stamp_ns
        self._last_ns = stamp_ns
        self._total += totals
        self._window.append((stamp_ns, totals))
        while self._window[0][0] <= stamp_ns - RECENT_NS:
            self._window.popleft()

    def recent(self) -> Tally:
        """Return the totals of the last 10 s."""
        first_ns = self._window[0][0] if self._window else self._last_ns
        sums = sum((totals for _, totals in self._window), start=ScoreTotals())
        return sums.tally(self._last_ns - first_ns)

    def total(self) -> Tally:
        """Return the totals of all frames."""
        return self._total.tally(self._last_ns - self._first_ns)


class IdConsistency:
    """Share of each person's matches under their most frequent track."""

    def __init__(self) -> None:
        self._tracks: dict[str, Counter[int]] = {}

    def add(self, person: str, track: int) -> None:
        """Count a match."""
        self._tracks.setdefault(person, Counter())[track] += 1

    def share(self, *persons: str) -> float | None:
        """Return the share over some people, all if none is named; None without a match."""
        counters = [self._tracks[p] for p in persons or self._tracks if p in self._tracks]
        matches = sum(counter.total() for counter in counters)
        return sum(max(c.values()) for c in counters) / matches if matches else None
