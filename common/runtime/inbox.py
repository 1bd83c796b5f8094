"""Queue of messages for a busy node, without messages of other replicas."""

import threading
import time
from collections.abc import Callable

from common.runtime.assignment import Assignment, PendingMessage, header_of, read_header
from common.transport.exchange import size_of
from people4d.messages import Message
from people4d.queue import Arrival, MessageQueue
from people4d.topics import Topic


class Inbox(MessageQueue):
    """Queue without the messages that are assigned to other replicas.

    Args:
        assignment: Divides messages between replicas; None: there is one replica.
        frames_waiting: Length of the queue of a "newest" topic.
        admits: Checks that a payload is useful; None: all payloads are useful.
    """

    def __init__(
        self,
        assignment: Assignment | None = None,
        frames_waiting: int = 1,
        admits: Callable[[Topic, bytes], bool] | None = None,
    ) -> None:
        super().__init__(frames_waiting, counts_gaps=admits is None)
        self._assignment, self._admits = assignment, admits

    def add_payload(self, topic: Topic, key: str, payload: bytes) -> None:
        """Decode a payload and add it unless it is assigned to another replica."""
        received_ns = time.time_ns()
        if self._admits and not self._admits(topic, payload):
            return
        if self._shares(topic):
            header = read_header(payload)
            if header and self._is_left(topic, PendingMessage(key, payload, received_ns, header)):
                return
        self._put(topic, key, payload, received_ns)

    def add_message(self, topic: Topic, key: str, message: Message) -> None:
        """Add a message of a service in this process unless it is assigned to another replica."""
        now_ns = time.time_ns()
        if self._shares(topic):
            pending = PendingMessage(key, message, now_ns, header_of(message))
            if self._is_left(topic, pending):
                return
        self._add(topic, key, Arrival(message, now_ns, now_ns, size=size_of(message)))

    def _shares(self, topic: Topic) -> bool:
        return self._assignment is not None and topic is self._assignment.topic

    def _is_left(self, topic: Topic, message: PendingMessage) -> bool:
        """Check for a message assigned to another replica, and count it."""
        if not self._assignment or self._assignment.is_ours(message, time.monotonic()):
            return False
        with self._changed:
            self.counters[f"left_{topic.name}"] += 1
            self._count_gap(topic, message.key, message.header.sequence)
        return True

    def take_over(self, message: PendingMessage) -> None:
        """Add a message taken over from another replica."""
        if self._assignment:
            topic = self._assignment.topic
            self.counters[f"taken_over_{topic.name}"] += 1
            if isinstance(message.payload, bytes):
                self._put(topic, message.key, message.payload, message.received_ns, again=True)
                return
            now_ns = time.time_ns()
            size = size_of(message.payload)
            arrival = Arrival(message.payload, message.received_ns, now_ns, size=size)
            self._add(topic, message.key, arrival, again=True)


class Turnstile:
    """Admits one thread at a time to the heavy part of a node, before it takes a message.

    Otherwise a second thread would take a frame, which would age while the first thread runs the
    network. With the turnstile the frame waits in the inbox, where a newer one replaces it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._holder: int | None = None

    def acquire(self, timeout_s: float) -> bool:
        """Wait for admission; return False after the timeout."""
        if not self._lock.acquire(timeout=timeout_s):
            return False
        self._holder = threading.get_ident()
        return True

    def release(self) -> None:
        """Admit the next thread; does nothing unless this thread was admitted."""
        if self._holder == threading.get_ident():
            self._holder = None
            self._lock.release()
