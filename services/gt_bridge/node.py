"""Re-publishes recorded truth, in pace with the pipeline or by its own clock."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import ClassVar, Literal

import msgspec

from common.errors import People4dError
from common.messages import Detections, Message, Truth
from common.node import Status

NS = 10**9
LEAD_NS = NS  # truth from more than this before the first frame is passed over


class GtBridgeNode:
    """Sends the truth up to each frame ("frames"), or as it was recorded ("recorded").

    A frame from well before the last one means that playback began again, and so does the truth.
    A camera that loops with rising stamps is followed round by round.

    Args:
        truth: Messages by rising stamp; iterated anew when playback begins again.
        pace: "frames" or "recorded".
        offset_ns: Added to each stamp.
        loop_ns: What a looping camera adds to its stamps each round; 0 if it does not loop.
    """

    inputs: ClassVar[tuple[type[Message], ...]] = (Detections,)

    def __init__(
        self,
        truth: Iterable[Truth],
        pace: Literal["frames", "recorded"] = "frames",
        offset_ns: int = 0,
        loop_ns: int = 0,
    ) -> None:
        self._truth = truth
        self._pace = pace
        self._offset_ns = offset_ns
        self._loop_ns = loop_ns
        self._round = 0
        self._counters: Counter[str] = Counter()
        self._problem = ""
        self._sequence = 0
        self._last_frame_ns: int | None = None
        self._started: tuple[int, int] | None = None  # monotonic time, stamp of the first truth
        self._rewind()
        self._first_ns = self._next.stamp_ns if self._next else 0
        self._empty = self._next is None and not self._problem

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Return the truth up to the stamp of a frame that the pipeline has dealt with."""
        if self._pace != "frames" or not isinstance(message, Detections) or self._empty:
            return ()
        stamp_ns, before_ns = message.stamp_ns, self._last_frame_ns
        self._last_frame_ns = stamp_ns
        turn = self._round_of(stamp_ns)
        again = before_ns is not None and stamp_ns < before_ns - LEAD_NS
        if turn != self._round or again:
            self._counters["restarts"] += 1
            self._round = turn
            self._rewind()
        if before_ns is None or again:
            self._pass_over(stamp_ns - LEAD_NS)
        return self._until(stamp_ns)

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Return the truth that is due by the recording's own pace."""
        if self._pace != "recorded" or self._next is None:
            return ()
        if self._started is None:
            self._started = now_ns, self._next.stamp_ns
        start_ns, stamp_ns = self._started
        return self._until(stamp_ns + now_ns - start_ns)

    def wake_ns(self) -> int | None:
        """Return when the next truth is due by the recording's own pace."""
        if self._pace != "recorded" or self._next is None:
            return None
        start_ns, stamp_ns = self._started or (0, self._next.stamp_ns)
        return start_ns + self._next.stamp_ns - stamp_ns

    def status(self) -> Status:
        """Return what the heartbeat shall say."""
        counters = dict(self._counters)
        if self._problem:
            return Status(state="degraded", reason=self._problem, counters=counters)
        if self._pace == "recorded" and self._next is None:
            return Status(state="finished", reason="all truth is out", counters=counters)
        return Status(reason="there is no truth" if self._empty else "", counters=counters)

    def close(self) -> None:
        """Nothing to release."""

    def _round_of(self, stamp_ns: int) -> int:
        if not self._loop_ns:
            return 0
        return max(0, (stamp_ns - self._first_ns) // self._loop_ns)

    def _rewind(self) -> None:
        self._messages: Iterator[Truth] = iter(self._truth)
        self._advance()

    def _advance(self) -> None:
        """Fetch the next message; a file that fails half-way ends the truth."""
        self._next: Truth | None = None
        try:
            message = next(self._messages, None)
        except People4dError as error:
            self._problem = str(error)
            return
        if message is not None:
            stamp_ns = message.stamp_ns + self._offset_ns + self._round * self._loop_ns
            self._next = msgspec.structs.replace(message, stamp_ns=stamp_ns, trace=())

    def _pass_over(self, stamp_ns: int) -> None:
        while self._next is not None and self._next.stamp_ns < stamp_ns:
            self._counters["passed_over"] += 1
            self._advance()

    def _until(self, stamp_ns: int) -> list[Message]:
        due: list[Message] = []
        while self._next is not None and self._next.stamp_ns <= stamp_ns:
            due.append(msgspec.structs.replace(self._next, sequence=self._sequence))
            self._sequence += 1
            self._advance()
        return due
