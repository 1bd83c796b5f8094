"""Hands that people hold up, to be chosen."""

from common.geometry.gestures import hand_raised
from common.held import HeldCondition
from people4d.messages import Skeletons

RAISED = 0.9  # minimum probability of a raised hand
HOLD_S = 1.0  # minimum duration of a raised hand [s]
GAP_NS = 1_000_000_000  # maximum age of skeletons [ns]


class RaisedHands:
    """Raised hands of people by their tracks."""

    def __init__(self) -> None:
        self._stamp_ns: int | None = None  # [ns] last skeletons
        self._hands: dict[int, HeldCondition] = {}

    def update(self, skeletons: Skeletons) -> None:
        """Add the skeletons of a frame; older ones begin again."""
        known = self._hands if self._is_recent(skeletons.stamp_ns) else {}
        self._stamp_ns = skeletons.stamp_ns
        self._hands = {one.id: known.get(one.id, HeldCondition()) for one in skeletons.people}
        for one in skeletons.people:
            probability = hand_raised(one.positions_m, one.covariances_m2, one.measured)
            self._hands[one.id].update(probability >= RAISED, skeletons.stamp_ns, HOLD_S)

    def held(self, stamp_ns: int) -> frozenset[int] | None:
        """Return the tracks with a hand raised for HOLD_S; None without recent skeletons."""
        if not self._is_recent(stamp_ns):
            return None
        return frozenset(number for number, hand in self._hands.items() if hand.is_reported)

    def _is_recent(self, stamp_ns: int) -> bool:
        return self._stamp_ns is not None and abs(stamp_ns - self._stamp_ns) <= GAP_NS
