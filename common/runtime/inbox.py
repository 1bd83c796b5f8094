"""Messages that wait for a busy node."""

import math
import threading
import time
from collections import Counter, deque
from dataclasses import dataclass

from common.runtime.sharing import Share, Spare, head_of
from common.transport.bus import Subscription
from people4d.codec import decode
from people4d.errors import DecodeError
from people4d.messages import Message, RgbdFrame, Tracks
from people4d.topics import ForeignTopic, Topic

FRESH_S = 3.0


@dataclass(frozen=True)
class Arrival:
    """A decoded message and when it came.

    Args:
        message: The message.
        received_ns: Wall clock when its bytes were there.
        decoded_ns: Wall clock when it was decoded.
        ticket: Order in which messages were taken out.
    """

    message: Message
    received_ns: int
    decoded_ns: int
    ticket: int = -1


class Inbox:
    """One bounded queue per key, emptied oldest first across keys.

    Of a "newest" topic only the newest messages wait, unless they must not be skipped (lock-step).
    Bytes that do not decode, messages pushed out and gaps in the sequence are counted.

    Args:
        share: Tells which messages other replicas do; these do not wait here. None: all are ours.
        newest: How many messages of a "newest" topic wait.
    """

    def __init__(self, share: Share | None = None, newest: int = 1) -> None:
        self._share, self._newest = share, newest
        self.counters: Counter[str] = Counter()
        self.last_error = ""
        self._failed_s = -math.inf
        self._queues: dict[str, deque[Arrival]] = {}
        self._last: dict[str, int] = {}
        self._changed = threading.Condition()
        self._woken = False
        self._taken = 0

    def put(self, topic: Topic, key: str, payload: bytes) -> None:
        """Decode a payload and let it wait; bad bytes are counted and dropped.

        Args:
            topic: Topic that it came on.
            key: Full key that it came on.
            payload: Untrusted bytes.
        """
        received_ns = time.time_ns()
        if self._share and topic is self._share.topic:
            head = head_of(payload)
            if head and not self._share.is_ours(Spare(key, payload, received_ns, head)):
                with self._changed:
                    self.counters[f"left_{topic.name}"] += 1
                    self._count_gap(topic, key, head.sequence)
                return
        self._put(topic, key, payload, received_ns)

    def take_over(self, spare: Spare) -> None:
        """Let a message wait that another replica should have done."""
        if self._share:
            topic = self._share.topic
            self.counters[f"taken_over_{topic.name}"] += 1
            self._put(topic, spare.key, spare.payload, spare.received_ns, again=True)

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
                # People of several cameras come on one key, each with its camera's numbers.
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

    def follow(self, subscription: Subscription, topic: Topic) -> threading.Thread:
        """Put what comes on a subscription until that is closed; return the thread that does it."""

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
        """Let a waiting `get` return now."""
        with self._changed:
            self._woken = True
            self._changed.notify_all()

    def last_error_is_fresh(self) -> bool:
        """Return whether bytes failed to decode within the last seconds."""
        return time.monotonic() - self._failed_s < FRESH_S

    def _count_gap(self, topic: Topic, source: str, sequence: int) -> None:
        self.counters[f"received_{topic.name}"] += 1
        last = self._last.get(source)
        self._last[source] = sequence
        numbered = topic.delivery == "newest" or topic.message is Tracks
        # A sequence that goes back is a restarted publisher, not a gap.
        if numbered and last is not None and sequence > last + 1:
            self.counters[f"gaps_{topic.name}"] += sequence - last - 1
