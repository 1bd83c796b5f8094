"""Bus of nodes in one thread, without a network: for tests and deterministic replay."""

from collections import deque
from collections.abc import Sequence

from common.runtime.node import Node
from people4d.codec import decode, encode
from people4d.messages import Message


class MemoryBus:
    """Delivers messages to nodes immediately.

    Args:
        nodes: The nodes, called in this order.
        codec: Pass each message through the codec, as between processes.
    """

    def __init__(self, nodes: Sequence[Node], codec: bool = True) -> None:
        self.nodes, self._codec = nodes, codec
        self.log: list[Message] = []
        self.now_ns = 0

    def publish(self, *messages: Message) -> list[Message]:
        """Deliver messages and all resulting messages.

        Args:
            messages: Messages in order.

        Returns:
            All messages published, these first.
        """
        start = len(self.log)
        waiting = deque(messages)
        while waiting:
            message = waiting.popleft()
            self.log.append(message)
            payload = encode(message) if self._codec else None
            for node in self.nodes:
                if isinstance(message, node.inputs):
                    received = decode(payload) if payload else message
                    waiting.extend(node.handle(received, self.now_ns))
        return self.log[start:]

    def advance(self, duration_ns: int = 0) -> list[Message]:
        """Advance the clock, then tick every node.

        Returns:
            All messages published.
        """
        self.now_ns += duration_ns
        return self.publish(*(m for node in self.nodes for m in node.tick(self.now_ns)))
