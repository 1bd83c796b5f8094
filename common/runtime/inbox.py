"""Queue of messages that wait for a busy node, or for the answers of its replicas."""

import time

from common.runtime.assignment import Assignment, PendingMessage, read_header
from people4d.queue import MessageQueue
from people4d.topics import Topic


class Inbox(MessageQueue):
    """Queue without the messages that are assigned to other replicas.

    Args:
        assignment: Divides messages between replicas; None: there is one replica.
        frames_waiting: Length of the queue of a "newest" topic.
    """

    def __init__(self, assignment: Assignment | None = None, frames_waiting: int = 1) -> None:
        super().__init__(frames_waiting)
        self._assignment = assignment

    def put(self, topic: Topic, key: str, payload: bytes) -> None:
        """Decode a payload and add it unless it is assigned to another replica.

        Args:
            topic: Topic that it came on.
            key: Full key that it came on.
            payload: Untrusted bytes.
        """
        received_ns = time.time_ns()
        if self._assignment and topic is self._assignment.topic:
            header = read_header(payload)
            pending = PendingMessage(key, payload, received_ns, header) if header else None
            if pending and not self._assignment.is_ours(pending):
                with self._changed:
                    self.counters[f"left_{topic.name}"] += 1
                    self._count_gap(topic, key, pending.header.sequence)
                return
        self._put(topic, key, payload, received_ns)

    def take_over(self, message: PendingMessage) -> None:
        """Add a message that another replica should have handled."""
        if self._assignment:
            topic = self._assignment.topic
            self.counters[f"taken_over_{topic.name}"] += 1
            self._put(topic, message.key, message.payload, message.received_ns, again=True)
