"""Client of a running system: the tracks around a robot in a few lines, on any machine."""

import logging
import os
import time
from collections.abc import Iterator
from typing import TypeVar

from people4d.codec import encode
from people4d.errors import People4dError
from people4d.messages import Message, Tracks
from people4d.queue import Arrival, MessageQueue
from people4d.session import ZenohSession, read_config
from people4d.topics import BY_MESSAGE

M = TypeVar("M", bound=Message)

POLL_S = 0.2  # maximum uninterrupted wait, for Ctrl-C [s]
SILENCE_S = 5.0  # maximum silence before `subscribe` logs robots and services found [s]
LOG = logging.getLogger("people4d")


class Client:
    """Receives messages of a running system through its router.

    Args:
        connect: Endpoint of the router, for example "tcp/192.168.1.7:7447"; empty for
            $PEOPLE4D_CONNECT, else the router on this host.
        robot: Name of the robot.
        timeout_s: Maximum wait for the router [s].
        warn_after_s: Silence after which the robots and services found are logged [s]; None: never.

    Raises:
        People4dError: No router answers, or it refuses the credentials.
    """

    def __init__(
        self,
        connect: str = "",
        robot: str = "robot",
        timeout_s: float = 3.0,
        warn_after_s: float | None = None,
    ) -> None:
        environment = dict(os.environ) | ({"PEOPLE4D_CONNECT": connect} if connect else {})
        self.session = ZenohSession(read_config(None, "client", environment), robot, timeout_s)
        self.queue = MessageQueue()
        self._warn_after_s = warn_after_s

    @property
    def counters(self) -> dict[str, int]:
        """Number of messages received, missed and dropped since the start.

        `received_people`; `gaps_people`: camera frames without a message, lost on the network or
        skipped by a busy detector; `dropped_people`: messages pushed out of a full queue;
        `bad_people`: payloads that do not decode. Other topics have the same counters.
        """
        return dict(self.queue.counters)

    def messages(self, *kinds: type[M], timeout_s: float | None = None) -> Iterator[M]:
        """Subscribe, and yield messages.

        Args:
            kinds: Types of message, for example Tracks.
            timeout_s: Silence after which the iteration ends [s]; None: it ends when closed.
        """
        arrivals = self.arrivals(*kinds, timeout_s=timeout_s)
        return (arrival.message for arrival in arrivals if isinstance(arrival.message, kinds))

    def arrivals(self, *kinds: type[Message], timeout_s: float | None = None) -> Iterator[Arrival]:
        """Subscribe, and yield messages with their times of arrival.

        Args:
            kinds: Types of message.
            timeout_s: Silence after which the iteration ends [s]; None: it ends when closed.
        """
        topics = [BY_MESSAGE[kind] for kind in kinds]
        subscriptions = [self.session.subscribe(topic) for topic in topics]
        for subscription, topic in zip(subscriptions, topics, strict=True):
            self.queue.follow(subscription, topic)

        def receive() -> Iterator[Arrival]:
            try:
                yield from self._receive(kinds, timeout_s)
            finally:
                for subscription in subscriptions:
                    subscription.close()

        return receive()

    def _receive(
        self, kinds: tuple[type[Message], ...], timeout_s: float | None
    ) -> Iterator[Arrival]:
        last_s, warn_after_s = time.monotonic(), self._warn_after_s
        while timeout_s is None or time.monotonic() - last_s < timeout_s:
            arrival = self.queue.get(POLL_S if timeout_s is None else min(timeout_s, POLL_S))
            if arrival is None and self.queue.failure:
                raise People4dError(f"receiving stopped: {self.queue.failure!r}")
            if arrival is None and self.session.closed:
                return
            if arrival and isinstance(arrival.message, kinds):
                yield arrival
                last_s, warn_after_s = time.monotonic(), None
            elif warn_after_s is not None and time.monotonic() - last_s > warn_after_s:
                LOG.warning("no message for %g s: %s", warn_after_s, self.found())
                warn_after_s = None

    def publish(self, message: Message) -> None:
        """Publish a message, for example the choice of the person to follow."""
        topic = BY_MESSAGE[type(message)]
        self.session.send_bytes(topic.key_of(message, self.session.robot), encode(message))

    def found(self) -> str:
        """Describe the robots and services with liveliness tokens."""
        present, robot = self.session.present(), self.session.robot
        robots = sorted({name for name, _, _ in present})
        services = sorted({service for name, service, _ in present if name == robot})
        if services:
            return f"of robot {robot!r} these services run: {', '.join(services)}"
        if robots:
            listing = ", ".join(map(repr, robots))
            return f"no robot {robot!r} is there, but {listing}; add --robot {robots[0]!r}"
        return "the router answers, but no service runs (people4d up)"

    def close(self) -> None:
        """Leave the network."""
        self.session.close()

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def subscribe(connect: str = "", robot: str = "robot") -> Iterator[Tracks]:
    """Yield the people around a robot, one message for every camera frame.

        for message in subscribe("tcp/192.168.1.7:7447"):
            for track in message.tracks:
                print(track.id, track.position_m, track.velocity_mps, track.yaw_rad)

    Args:
        connect: Endpoint of the router; empty for $PEOPLE4D_CONNECT, else the one on this host.
        robot: Name of the robot.

    Raises:
        People4dError: No router answers, or it refuses the credentials.
    """
    with Client(connect, robot, warn_after_s=SILENCE_S) as client:
        for arrival in client.arrivals(Tracks):
            if isinstance(arrival.message, Tracks):
                yield arrival.message
