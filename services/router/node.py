"""Node of the router."""

from collections.abc import Sequence

from common.runtime.node import Node
from people4d.messages import Message


class RouterNode(Node):
    """Node without inputs and outputs: Zenoh does the routing."""

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Return nothing."""
        return ()
