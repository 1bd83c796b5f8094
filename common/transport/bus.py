"""Interface of the bus that carries messages between nodes, and a bus that needs no network."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from common.runtime.node import Node
from common.transport.clock import QuerySender, QueryServer
from people4d.codec import decode, encode
from people4d.messages import Message, Span
from people4d.topics import Topic


class Subscription(Protocol):
    """Payloads of one topic as they arrive."""

    def __iter__(self) -> Iterator[tuple[str, bytes]]:
        """Yield key and payload, block until one comes, end when closed."""
        ...

    def close(self) -> None:
        """End the iteration."""
        ...


@dataclass(frozen=True)
class Member:
    """A process of a service that joined or left."""

    instance: str  # its name
    present: bool  # True if it joined


class Members(Protocol):
    """Processes of one service as they join and leave."""

    def __iter__(self) -> Iterator[Member]:
        """Yield the present ones, then changes; end when closed."""
        ...

    def close(self) -> None:
        """End the iteration."""
        ...


class Bus(QuerySender, QueryServer, Protocol):
    """Carries messages to other processes; publish may be called from any thread."""

    def publish(self, message: Message, publishing: Callable[[], Span] | None = None) -> None:
        """Send a message on the key that the topic table gives it.

        Args:
            message: The message.
            publishing: Returns the last stage of its trace; called when it is encoded.
        """
        ...

    def subscribe(self, topic: Topic, own: bool = True) -> Subscription:
        """Receive a topic; of a latched one the last message of each key comes first.

        Args:
            topic: The topic.
            own: Receive this process's own messages, too.
        """
        ...

    def announce(self, service: str, instance: str) -> None:
        """Announce this process, until it withdraws or ends."""
        ...

    def withdraw(self) -> None:
        """End the announcement; does nothing if there is none."""
        ...

    def members(self, service: str) -> Members:
        """Receive announcements of a service, and their ends."""
        ...

    def close(self) -> None:
        """End all subscriptions and leave the network."""
        ...


class MemoryBus:
    """Nodes wired in one thread: for tests and deterministic replay.

    Every message passes the codec, as it would between processes.

    Args:
        nodes: The nodes, called in this order.
    """

    def __init__(self, nodes: Sequence[Node]) -> None:
        self.nodes = nodes
        self.log: list[Message] = []
        self.now_ns = 0

    def publish(self, *messages: Message) -> list[Message]:
        """Deliver messages and all that follows from them.

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
            payload = encode(message)
            for node in self.nodes:
                if isinstance(message, node.inputs):
                    waiting.extend(node.handle(decode(payload), self.now_ns))
        return self.log[start:]

    def advance(self, duration_ns: int = 0) -> list[Message]:
        """Let time pass, then tick every node.

        Args:
            duration_ns: Time that passes.

        Returns:
            All messages published.
        """
        self.now_ns += duration_ns
        return self.publish(*(m for node in self.nodes for m in node.tick(self.now_ns)))
