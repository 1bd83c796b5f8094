"""Messages that wait for a busy node, some of them for its replicas."""

import time

from common.runtime.sharing import Share, Spare, head_of
from people4d.queue import MessageQueue
from people4d.topics import Topic


class Inbox(MessageQueue):
    """A queue that leaves to other replicas what they do.

    Args:
        share: The messages of other replicas; these do not wait here. None: there is one replica.
        newest: Number of messages of a "newest" topic that wait.
    """

    def __init__(self, share: Share | None = None, newest: int = 1) -> None:
        super().__init__(newest)
        self._share = share

    def put(self, topic: Topic, key: str, payload: bytes) -> None:
        """Decode a payload and add it unless another replica does it.

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
        """Add a message that another replica should have done."""
        if self._share:
            topic = self._share.topic
            self.counters[f"taken_over_{topic.name}"] += 1
            self._put(topic, spare.key, spare.payload, spare.received_ns, again=True)
