"""Playback of stored truth with the frames of the pipeline."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator

import msgspec

from people4d.errors import People4dError
from people4d.messages import Truth
from services.gt_bridge.config import GtBridgeConfig

NS = 10**9
LOOP_SLACK_NS = 1_000_000  # tolerance of the start of a round, which cameras round [ns]
LEAD_NS = NS  # maximum lead of truth before the first frame [ns]


class TruthPlayback:
    """Plays the truth up to each frame.

    A frame well before the last one restarts the truth. Truth also follows the rounds of a camera
    that loops with rising stamps.

    Args:
        config: Offset and length of a round.
        truth: Messages with rising stamps; iterated again at each restart.
        counters: Counts skipped truth and restarts.
        prepare: Returns the published form of a message; called one message ahead.
    """

    def __init__(
        self,
        config: GtBridgeConfig,
        truth: Iterable[Truth],
        counters: Counter[str],
        prepare: Callable[[Truth], Truth],
    ) -> None:
        self._truth = truth
        self._offset_ns = round(config.offset_s * NS)
        self._loop_ns = round(config.loop_s * NS)
        self._counters = counters
        self._prepare = prepare
        self._round = 0
        self.problem = ""  # reason why the truth ended early
        self._last_frame_ns: int | None = None
        self._rewind()
        self._first_ns = self._next.stamp_ns if self._next else 0
        self.empty = self._next is None and not self.problem

    def restarts(self, stamp_ns: int) -> bool:
        """Return True, and restart the truth, if playback restarts with a frame."""
        before_ns, round_ = self._last_frame_ns, self._round_of(stamp_ns)
        again = before_ns is not None and stamp_ns < before_ns - LEAD_NS
        if self.empty or (round_ == self._round and not again):
            return False
        self._counters["restarts"] += 1
        self._round = round_
        if again:
            self._last_frame_ns = None
        self._rewind()
        return True

    def up_to(self, stamp_ns: int) -> list[Truth]:
        """Return the truth up to the stamp of a frame."""
        if self._last_frame_ns is None:
            while self._next is not None and self._next.stamp_ns < stamp_ns - LEAD_NS:
                self._counters["skipped"] += 1
                self._advance()
        self._last_frame_ns = stamp_ns
        due: list[Truth] = []
        while self._next is not None and self._next.stamp_ns <= stamp_ns:
            due.append(self._next)
            self._advance()
        return due

    def _round_of(self, stamp_ns: int) -> int:
        if not self._loop_ns:
            return 0
        return max(0, (stamp_ns - self._first_ns + LOOP_SLACK_NS) // self._loop_ns)

    def _rewind(self) -> None:
        self._messages: Iterator[Truth] = iter(self._truth)
        self._advance()

    def _advance(self) -> None:
        """Read the next message; a damaged file ends the truth."""
        self._next: Truth | None = None
        try:
            message = next(self._messages, None)
        except People4dError as error:
            self.problem = str(error)
            return
        if message is not None:
            stamp_ns = message.stamp_ns + self._offset_ns + self._round * self._loop_ns
            try:
                message = msgspec.structs.replace(message, stamp_ns=stamp_ns, trace=())
            except ValueError as error:
                self.problem = f"the truth's stamps cannot be moved so far: {error}"
                return
            self._next = self._prepare(message)
