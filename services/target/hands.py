"""Hands that people hold up, to be chosen."""

from common.geometry.gestures import hand_raised
from people4d.messages import Skeletons

RAISED = 0.9  # minimum probability of a raised hand
HOLD_NS = 1_000_000_000  # minimum duration of a raised hand [ns]
GAP_NS = 1_000_000_000  # maximum age of skeletons [ns]


class RaisedHands:
    """Tracks of people by the time since which they hold up a hand."""

    def __init__(self) -> None:
        self._stamp_ns: int | None = None  # [ns] last skeletons
        self._since_ns: dict[int, int] = {}

    def update(self, skeletons: Skeletons) -> None:
        """Add the skeletons of a frame; older ones begin again."""
        if not self._is_recent(skeletons.stamp_ns):
            self._since_ns = {}
        self._stamp_ns = skeletons.stamp_ns
        self._since_ns = {
            one.id: self._since_ns.get(one.id, skeletons.stamp_ns)
            for one in skeletons.people
            if hand_raised(one.positions_m, one.covariances_m2, one.measured) >= RAISED
        }

    def held(self, stamp_ns: int) -> frozenset[int] | None:
        """Return the tracks with a hand raised for HOLD_NS; None without recent skeletons."""
        if not self._is_recent(stamp_ns):
            return None
        last_ns = self._stamp_ns or 0
        return frozenset(i for i, since in self._since_ns.items() if last_ns - since >= HOLD_NS)

    def _is_recent(self, stamp_ns: int) -> bool:
        return self._stamp_ns is not None and abs(stamp_ns - self._stamp_ns) <= GAP_NS
