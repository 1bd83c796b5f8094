"""Transport of ROS 2 topics inside of a test."""

from dataclasses import dataclass, field
from typing import Any

from common.ros2 import types
from common.ros2.config import Ros2Config
from common.ros2.names import TopicType
from common.ros2.transport import (
    DEFAULT,
    Qos,
    Receive,
    Ros2Publisher,
    Ros2Sample,
    Ros2Transport,
)


@dataclass
class MemoryTopic:
    """A topic that was announced."""

    kind: str
    qos: Qos
    payloads: list[bytes] = field(default_factory=list)
    closed: bool = False


class MemoryTransport(Ros2Transport):
    """Stores published messages, and delivers messages of a test."""

    def __init__(self, config: Ros2Config | None = None) -> None:
        super().__init__()
        self._config = config or Ros2Config()
        self.topics: dict[str, MemoryTopic] = {}
        self.subscriptions: dict[str, tuple[str, Receive, Qos]] = {}
        self.closed = False

    def publisher(self, topic: str, kind: str, qos: Qos = DEFAULT) -> Ros2Publisher:
        name = TopicType.from_names(self._config, topic, kind).topic
        self.topics[name] = MemoryTopic(kind, qos)
        return _MemoryPublisher(self.topics[name])

    def subscribe(self, topic: str, kind: str, receive: Receive, qos: Qos = DEFAULT) -> None:
        self.subscriptions[TopicType.from_names(self._config, topic, kind).topic] = (
            kind,
            receive,
            qos,
        )

    def close(self) -> None:
        self.closed = True

    def messages(self, topic: str) -> list[Any]:
        """Return the messages published on a topic, as decoded by its readers."""
        sent = self.topics[topic]
        return [types.decode(sent.kind, payload) for payload in sent.payloads]

    def last(self, topic: str) -> Any:
        """Return the last message on a topic."""
        return self.messages(topic)[-1]

    def send(self, topic: str, cdr: bytes) -> None:
        """Deliver a message to the node."""
        self.deliver(self.subscriptions[topic][1], Ros2Sample(cdr, sent_ns=0))


class _MemoryPublisher(Ros2Publisher):
    def __init__(self, topic: MemoryTopic) -> None:
        self._topic = topic

    def send(self, cdr: bytes) -> None:
        self._topic.payloads.append(cdr)

    def close(self) -> None:
        self._topic.closed = True
