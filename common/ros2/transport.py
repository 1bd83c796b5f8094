"""Interface of the transports that carry topics of ROS 2."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from people4d.errors import DecodeError

COUNTERS = (
    *("bad_message", "other_type", "other_qos", "no_attachment"),
    *("receive_errors", "send_errors"),
)


@dataclass(frozen=True)
class Qos:
    """Quality of service of a publisher or subscription, history "keep last"."""

    reliability: Literal["reliable", "best_effort"] = "reliable"
    # transient_local: late joiners get the last `depth` messages
    durability: Literal["volatile", "transient_local"] = "volatile"
    depth: int = 10  # length of the queue


DEFAULT = Qos()
SENSOR_DATA = Qos("best_effort", "volatile", 5)
LATCHED = Qos("reliable", "transient_local", 1)


@dataclass(frozen=True, slots=True)
class Ros2Sample:
    """One received message."""

    cdr: bytes  # payload with its header of 4 bytes
    sent_ns: int  # wall clock of its publisher at sending [ns]; 0: unknown


Receive = Callable[[Ros2Sample], None]


class Ros2Publisher(ABC):
    """Publisher of one topic, see `Ros2Transport.publisher`."""

    @abstractmethod
    def send(self, cdr: bytes) -> None:
        """Publish a message; a failure is counted as send_errors, not raised."""

    @abstractmethod
    def close(self) -> None:
        """Leave the topic."""


class Ros2Transport(ABC):
    """Node of ROS 2 with its publishers and subscriptions.

    Attributes:
        counters: Dropped messages by cause: bad_message (invalid CDR), other_type (another type or
            type hash on the topic; on DDS also a publisher with another type), other_qos (on DDS,
            publishers with a lower quality of service than requested), no_attachment (absent or
            truncated, with rmw_zenoh), receive_errors and send_errors.
    """

    def __init__(self) -> None:
        self.counters = Counter(dict.fromkeys(COUNTERS, 0))

    @abstractmethod
    def publisher(self, topic: str, kind: str, qos: Qos = DEFAULT) -> Ros2Publisher:
        """Announce a topic.

        ConfigError if ROS has no such name, or the type is unknown.

        Args:
            topic: Name; without "/" in front it is below the node's namespace.
            kind: Type, for example "people_msgs/msg/People".
            qos: Quality of service.
        """

    @abstractmethod
    def subscribe(self, topic: str, kind: str, receive: Receive, qos: Qos = DEFAULT) -> None:
        """Receive a topic until `close`.

        ConfigError if ROS has no such name, or the type is unknown.

        Args:
            topic: Name as in `publisher`.
            kind: Type; messages of other types are dropped and counted.
            receive: Called in a thread of the subscription. Its exceptions are counted, DecodeError
                as bad_message, others as receive_errors. During a call only the newest `depth`
                messages wait.
            qos: Quality of service.
        """

    @abstractmethod
    def close(self) -> None:
        """End all publishers and subscriptions, and leave the network."""

    def deliver(self, receive: Receive, sample: Ros2Sample) -> None:
        """Pass a message to its receiver, and count the receiver's exceptions."""
        try:
            receive(sample)
        except DecodeError:
            self.counters["bad_message"] += 1
        except Exception:  # a fault of the receiver must not end the subscription
            self.counters["receive_errors"] += 1
