"""Received messages that wait for their reader."""

import math
import threading
import time
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from heapq import heapify, heappop, heappush

from people4d.codec import decode
from people4d.errors import DecodeError
from people4d.messages import Message
from people4d.topics import BY_MESSAGE, ForeignTopic, Topic

FRESH_S = 3.0  # maximum age of a decoding error in a heartbeat [s]
WAITING_MAX = 2048  # maximum number of waiting messages of all keys
WAITING_MAX_BYTES = 128 * 2**20  # maximum size of all waiting messages, encoded
OUTDATED_MAX = 64  # maximum number of outdated entries in the order
SOURCES_MAX = 1024  # maximum number of sources with a known sequence


@dataclass(frozen=True)
class Arrival:
    """A decoded message with its times of arrival."""

    message: Message  # the message
    received_ns: int  # wall clock of its arrival
    decoded_ns: int  # wall clock at the end of decoding
    ticket: int = -1  # position in the order of removal
    size: int = 0  # [bytes] encoded


class RefusedPayload(bytes):
    """Placeholder of refused payloads, empty.

    Args:
        reason: Expected and actual value.
        number: Number of payloads.
        counter: Prefix of their counter, before the topic.
    """

    def __new__(cls, reason: str, number: int = 1, counter: str = "bad") -> "RefusedPayload":
        """Create the placeholder."""
        made = super().__new__(cls)
        made.reason, made.number, made.counter = reason, number, counter
        return made

    reason: str
    number: int
    counter: str


class MessageQueue:
    """One bounded queue per key, emptied oldest first across keys.

    Only the newest messages of a "newest" topic wait, unless they are lossless (lock-step). Bytes
    that do not decode, dropped messages and gaps in the sequence are counted. The size of all
    waiting messages is limited, and only keys with waiting messages cost time.

    Args:
        newest: Maximum number of waiting messages of a "newest" topic.
        counts_gaps: False if messages are filtered on purpose.
    """

    def __init__(self, newest: int = 1, counts_gaps: bool = True) -> None:
        self._newest, self._counts_gaps = newest, counts_gaps
        self.counters: Counter[str] = Counter()
        self.last_error = ""
        self._failed_s = -math.inf
        self._queues: dict[str, deque[Arrival]] = {}  # non-empty queues by key
        # Heap of the oldest message of each key with the number of its entry, and outdated entries
        self._order: list[tuple[int, int, str]] = []
        self._entries: dict[str, int] = {}  # number of the valid entry, by key
        self._entered = 0
        self._waiting = self._waiting_bytes = 0
        self._last: dict[str, int] = {}
        self._changed = threading.Condition()
        self._woken = False
        self.failure: Exception | None = None  # exception that ended a thread of `follow`
        self._taken = 0

    def add_payload(self, topic: Topic, key: str, payload: bytes) -> None:
        """Decode a payload and add it; bad bytes are counted and dropped.

        Args:
            topic: Topic of the message.
            key: Full key of the message.
            payload: Untrusted bytes.
        """
        self._put(topic, key, payload, time.time_ns())

    def _put(
        self, topic: Topic, key: str, payload: bytes, received_ns: int, again: bool = False
    ) -> None:
        try:
            if isinstance(payload, RefusedPayload):
                raise DecodeError(f"{topic.name}: {payload.reason}")
            message = topic.decode(payload) if isinstance(topic, ForeignTopic) else decode(payload)
            if type(message) is not topic.message:
                raise DecodeError(
                    f"{topic.name}: expected {topic.message.__name__}, got {type(message).__name__}"
                )
        except DecodeError as error:
            with self._changed:
                refused = payload if isinstance(payload, RefusedPayload) else RefusedPayload("")
                self.counters[f"{refused.counter}_{topic.name}"] += refused.number
                self.last_error = str(error)
                self._failed_s = time.monotonic()
            return
        arrival = Arrival(message, received_ns, time.time_ns(), size=len(payload))
        self._add(topic, key, arrival, again)

    def _add(self, topic: Topic, key: str, arrival: Arrival, again: bool = False) -> None:
        message = arrival.message
        with self._changed:
            if not again:
                # Tracks of several cameras share one key, numbered by camera.
                by_field = topic.numbered not in ("", "key")
                source = f"{key} {getattr(message, topic.numbered)}" if by_field else key
                self._count_gap(topic, source, message.sequence)
            keep = (self._newest if topic.may_be_replaced(message) else topic.depth) - 1
            while len(self._queues.get(key, ())) > keep:
                self._pop(key)
                self.counters[f"dropped_{topic.name}"] += 1
            queue = self._queues.setdefault(key, deque())
            queue.append(arrival)
            self._waiting, self._waiting_bytes = (
                self._waiting + 1,
                self._waiting_bytes + arrival.size,
            )
            if again:  # requeued message: the oldest one
                queue.rotate()
            if queue[0] is arrival:
                self._enter(key)
            while self._waiting > 1 and self._is_full():
                dropped = BY_MESSAGE.get(type(self._pop_oldest().message), topic)
                self.counters[f"dropped_{dropped.name}"] += 1
            self._changed.notify()

    def follow(self, subscription: Iterable[tuple[str, bytes]], topic: Topic) -> threading.Thread:
        """Add the payloads of a subscription until its end, in the returned thread."""

        def receive() -> None:
            try:
                for key, payload in subscription:
                    self.add_payload(topic, key, payload)
                    del payload  # frees memory before the next payload
            except Exception as error:
                self.failure = error
                self.wake()
                raise

        thread = threading.Thread(target=receive, name=topic.name, daemon=True)
        thread.start()
        return thread

    def get(self, timeout_s: float | None) -> Arrival | None:
        """Remove and return the oldest message.

        Args:
            timeout_s: Maximum wait [s]; None for no limit.

        Returns:
            The message; None after the timeout or a call of `wake`.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._woken or self._queues, timeout_s)
            self._woken = False
            if not self._queues:
                return None
            oldest = self._pop_oldest()
            self._taken += 1
            return replace(oldest, ticket=self._taken - 1)

    def wake(self) -> None:
        """End a waiting `get`."""
        with self._changed:
            self._woken = True
            self._changed.notify_all()

    def last_error_is_fresh(self) -> bool:
        """Check whether a payload failed to decode in the last FRESH_S seconds."""
        return time.monotonic() - self._failed_s < FRESH_S

    def _is_full(self) -> bool:
        return self._waiting > WAITING_MAX or self._waiting_bytes > WAITING_MAX_BYTES

    def _pop_oldest(self) -> Arrival:
        while True:  # skip outdated entries
            _, number, key = heappop(self._order)
            if self._entries.get(key) == number:
                return self._pop(key)

    def _enter(self, key: str) -> None:
        """Enter the first message of a key into the order of all keys."""
        self._entered += 1
        self._entries[key] = self._entered
        heappush(self._order, (self._queues[key][0].received_ns, self._entered, key))
        if len(self._order) > 2 * len(self._queues) + OUTDATED_MAX:
            self._order = [
                entry for entry in self._order if self._entries.get(entry[2]) == entry[1]
            ]
            heapify(self._order)

    def _pop(self, key: str) -> Arrival:
        queue = self._queues[key]
        arrival = queue.popleft()
        if queue:
            self._enter(key)
        else:
            del self._queues[key], self._entries[key]
        self._waiting, self._waiting_bytes = self._waiting - 1, self._waiting_bytes - arrival.size
        return arrival

    def _count_gap(self, topic: Topic, source: str, sequence: int) -> None:
        self.counters[f"received_{topic.name}"] += 1
        last = self._last.pop(source, sequence)
        self._last[source] = sequence  # the most recent source is forgotten last
        if len(self._last) > SOURCES_MAX:
            del self._last[next(iter(self._last))]
        # A sequence that goes back is a restarted publisher, not a gap.
        if self._counts_gaps and topic.numbered and sequence > last + 1:
            self.counters[f"gaps_{topic.name}"] += sequence - last - 1
