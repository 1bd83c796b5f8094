"""Playback of stored truth, with the frames of the pipeline or by its own clock."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator

import msgspec

from people4d.errors import People4dError
from people4d.messages import Truth
from services.gt_bridge.config import GtBridgeConfig

NS = 10**9
LOOP_SLACK_NS = 1_000_000  # a camera rounds the length of each round to a nanosecond
LEAD_NS = NS  # truth from more than this before the first frame is skipped


class TruthPlayback:
    """Plays the truth up to each frame ("frames"), or by its own clock ("recorded").

    A frame from well before the last one means that playback began again, and so does the truth.
    A camera that loops with rising stamps is followed round by round.

    Args:
        config: Pace, offset and length of a round.
        truth: Messages by rising stamp; iterated anew when playback begins again.
        counters: Counts skipped truth and restarts.
        prepare: Called with each message before it is due, since the next one is always read;
            returns the message to be published.
    """

    def __init__(
        self,
        config: GtBridgeConfig,
        truth: Iterable[Truth],
        counters: Counter[str],
        prepare: Callable[[Truth], Truth],
    ) -> None:
        self._truth = truth
        self._by_clock = config.playback == "recorded"
        self._offset_ns = round(config.offset_s * NS)
        self._loop_ns = round(config.loop_s * NS)
        self._counters = counters
        self._prepare = prepare
        self._round = 0
        self.problem = ""  # reason for which the truth ended early
        self._last_frame_ns: int | None = None
        self._started: tuple[int, int] | None = None  # monotonic time, stamp of the first truth
        self._rewind()
        self._first_ns = self._next.stamp_ns if self._next else 0
        self.empty = self._next is None and not self.problem

    @property
    def finished(self) -> bool:
        """True if all truth was published, by its own clock."""
        return self._by_clock and self._next is None

    def restarts(self, stamp_ns: int) -> bool:
        """Check whether playback begins again with a frame; then so does the truth."""
        before_ns, round_ = self._last_frame_ns, self._round_of(stamp_ns)
        again = before_ns is not None and stamp_ns < before_ns - LEAD_NS
        if self._by_clock or self.empty or (round_ == self._round and not again):
            return False
        self._counters["restarts"] += 1
        self._round = round_
        if again:
            self._last_frame_ns = None
        self._rewind()
        return True

    def up_to(self, stamp_ns: int) -> list[Truth]:
        """Return the truth up to the stamp of a frame."""
        if self._by_clock or self.empty:
            return []
        if self._last_frame_ns is None:
            self._skip(stamp_ns - LEAD_NS)
        self._last_frame_ns = stamp_ns
        return self._until(stamp_ns)

    def due(self, now_ns: int) -> list[Truth]:
        """Return the truth that is due by the recording's own clock."""
        if not self._by_clock or self._next is None:
            return []
        if self._started is None:
            self._started = now_ns, self._next.stamp_ns
        start_ns, stamp_ns = self._started
        return self._until(stamp_ns + now_ns - start_ns)

    def wake_ns(self) -> int | None:
        """Return the time at which the next truth is due by the recording's own clock."""
        if not self._by_clock or self._next is None:
            return None
        start_ns, stamp_ns = self._started or (0, self._next.stamp_ns)
        return start_ns + self._next.stamp_ns - stamp_ns

    def _round_of(self, stamp_ns: int) -> int:
        if not self._loop_ns:
            return 0
        return max(0, (stamp_ns - self._first_ns + LOOP_SLACK_NS) // self._loop_ns)

    def _rewind(self) -> None:
        self._messages: Iterator[Truth] = iter(self._truth)
        self._advance()

    def _advance(self) -> None:
        """Fetch the next message; a file that fails half through ends the truth."""
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

    def _skip(self, stamp_ns: int) -> None:
        while self._next is not None and self._next.stamp_ns < stamp_ns:
            self._counters["skipped"] += 1
            self._advance()

    def _until(self, stamp_ns: int) -> list[Truth]:
        due: list[Truth] = []
        while self._next is not None and self._next.stamp_ns <= stamp_ns:
            due.append(self._next)
            self._advance()
        return due
