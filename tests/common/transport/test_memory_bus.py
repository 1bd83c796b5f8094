"""Nodes wired in one thread."""

from collections.abc import Sequence

from common.runtime.node import Node
from common.transport.memory_bus import MemoryBus
from people4d.messages import Detections, Message, Odometry, Tracks, Truth
from tests import builders
from tests.common.nodes import Echo, Source, detections
from tests.contract.examples import BY_NAME


class Evaluator(Node):
    """Answers Tracks with Truth, and sends one Odometry when it is due."""

    inputs: tuple[type[Message], ...] = (Tracks,)

    def __init__(self) -> None:
        self.ticks_ns: list[int] = []

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        return [builders.truth(stamp_ns=message.stamp_ns, sequence=message.sequence)]

    def tick(self, now_ns: int) -> Sequence[Message]:
        self.ticks_ns.append(now_ns)
        return [BY_NAME["Odometry"]] if now_ns >= 100 else []

    def wake_ns(self) -> int | None:
        return 100


def test_message_is_followed_by_all_its_consequences() -> None:
    bus = MemoryBus([Echo(), Evaluator()])
    published = bus.publish(detections(1), detections(2))
    assert [(type(m), m.sequence) for m in published] == [
        (Detections, 1),
        (Detections, 2),
        (Tracks, 1),
        (Tracks, 2),
        (Truth, 1),
        (Truth, 2),
    ]
    assert bus.log == published
    assert bus.publish(detections(3)) == bus.log[6:]


def test_order_of_the_nodes_does_not_matter_to_a_chain() -> None:
    one, other = MemoryBus([Echo(), Evaluator()]), MemoryBus([Evaluator(), Echo()])
    message = detections(1)
    assert [type(m) for m in one.publish(message)] == [type(m) for m in other.publish(message)]


def test_message_without_a_reader_is_only_logged() -> None:
    node = Echo()
    assert MemoryBus([node]).publish(BY_NAME["Health"]) == [BY_NAME["Health"]]
    assert node.handled == []


def test_time_passes_only_in_advance() -> None:
    evaluator = Evaluator()
    bus = MemoryBus([evaluator, Source(1)])
    assert [type(m) for m in bus.advance(99)] == [Truth]
    assert bus.advance() == []
    assert [type(m) for m in bus.advance(1)] == [Odometry]
    assert evaluator.ticks_ns == [99, 99, 100]


def test_messages_pass_the_codec() -> None:
    # A node gets its own read-only arrays, as from another process.
    received: list[Message] = []
    message = detections(1)
    MemoryBus([Echo(received.append)]).publish(message)
    assert received[0] == message
    assert received[0] is not message
