"""Received messages that wait for their reader."""

import math
import threading
import time
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass

from people4d.codec import decode
from people4d.errors import DecodeError
from people4d.messages import Message, RgbdFrame, Tracks
from people4d.topics import ForeignTopic, Topic

FRESH_S = 3.0


@dataclass(frozen=True)
class Arrival:
    """A decoded message and when it came."""

    message: Message  # the message
    received_ns: int  # wall clock when its bytes were there
    decoded_ns: int  # wall clock when it was decoded
    ticket: int = -1  # order in which messages were taken out


class MessageQueue:
    """One bounded queue per key, emptied oldest first across keys.

    Of a "newest" topic only the newest messages wait, unless they must not be skipped (lock-step).
    Bytes that do not decode, messages pushed out and gaps in the sequence are counted.

    Args:
        newest: Number of messages of a "newest" topic that wait.
    """

    def __init__(self, newest: int = 1) -> None:
        self._newest = newest
        self.counters: Counter[str] = Counter()
        self.last_error = ""
        self._failed_s = -math.inf
        self._queues: dict[str, deque[Arrival]] = {}
        self._last: dict[str, int] = {}
        self._changed = threading.Condition()
        self._woken = False
        self._taken = 0

    def put(self, topic: Topic, key: str, payload: bytes) -> None:
        """Decode a payload and add it; bad bytes are counted and dropped.

        Args:
            topic: Topic that it came on.
            key: Full key that it came on.
            payload: Untrusted bytes.
        """
        self._put(topic, key, payload, time.time_ns())

    def _put(
        self, topic: Topic, key: str, payload: bytes, received_ns: int, again: bool = False
    ) -> None:
        try:
            message = topic.decode(payload) if isinstance(topic, ForeignTopic) else decode(payload)
            if type(message) is not topic.message:
                raise DecodeError(
                    f"{topic.name}: expected {topic.message.__name__}, got {type(message).__name__}"
                )
        except DecodeError as error:
            with self._changed:
                self.counters[f"bad_{topic.name}"] += 1
                self.last_error = str(error)
                self._failed_s = time.monotonic()
            return
        arrival = Arrival(message, received_ns, time.time_ns())
        with self._changed:
            if not again:
                # Tracks of several cameras come on one key, each with its camera's numbers.
                source = f"{key} {message.camera}" if isinstance(message, Tracks) else key
                self._count_gap(topic, source, message.sequence)
            queue = self._queues.setdefault(key, deque())
            skippable = not (isinstance(message, RgbdFrame) and message.lockstep)
            is_newest = topic.delivery == "newest" and skippable
            keep = (self._newest if is_newest else topic.depth) - 1
            while len(queue) > keep:
                queue.popleft()
                self.counters[f"dropped_{topic.name}"] += 1
            queue.append(arrival)
            if again:  # it has waited longest
                queue.rotate()
            self._changed.notify()

    def follow(self, subscription: Iterable[tuple[str, bytes]], topic: Topic) -> threading.Thread:
        """Add what a subscription yields until that ends; return the thread that does it."""

        def receive() -> None:
            for key, payload in subscription:
                self.put(topic, key, payload)

        thread = threading.Thread(target=receive, name=topic.name, daemon=True)
        thread.start()
        return thread

    def get(self, timeout_s: float | None) -> Arrival | None:
        """Take the message that waits longest.

        Args:
            timeout_s: Longest wait in seconds, None for no limit.

        Returns:
            The message; None when the time is up or `wake` was called.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._woken or any(self._queues.values()), timeout_s)
            self._woken = False
            waiting = [queue for queue in self._queues.values() if queue]
            if not waiting:
                return None
            oldest = min(waiting, key=lambda queue: queue[0].received_ns).popleft()
            self._taken += 1
            return Arrival(oldest.message, oldest.received_ns, oldest.decoded_ns, self._taken - 1)

    def wake(self) -> None:
        """End a waiting `get` now."""
        with self._changed:
            self._woken = True
            self._changed.notify_all()

    def last_error_is_fresh(self) -> bool:
        """Check that bytes failed to decode within the last seconds."""
        return time.monotonic() - self._failed_s < FRESH_S

    def _count_gap(self, topic: Topic, source: str, sequence: int) -> None:
        self.counters[f"received_{topic.name}"] += 1
        last = self._last.get(source)
        self._last[source] = sequence
        numbered = topic.delivery == "newest" or topic.message is Tracks
        # A sequence that goes back is a restarted publisher, not a gap.
        if numbered and last is not None and sequence > last + 1:
            self.counters[f"gaps_{topic.name}"] += sequence - last - 1
