"""The few lines a planner needs: people as they are told, on any machine."""

import os
import time
from collections.abc import Iterator
from typing import TypeVar

from common.runtime.inbox import Arrival, Inbox
from common.transport.bus import Subscription
from common.transport.zenoh_bus import ZenohBus, read_config
from people4d.messages import Message, Tracks
from people4d.topics import BY_MESSAGE, Topic

M = TypeVar("M", bound=Message)


class Client:
    """Receives messages of a running system through its router.

    Args:
        connect: Endpoint of the router, for example "tcp/192.168.1.7:7447"; empty for
            $PEOPLE4D_CONNECT, else the router on this host.
        robot: Name of the robot.
        timeout_s: Longest wait for the router in seconds.

    Raises:
        People4dError: No router answers, or it refuses the credentials.
    """

    def __init__(self, connect: str = "", robot: str = "robot", timeout_s: float = 3.0) -> None:
        environment = dict(os.environ)
        if connect:
            environment["PEOPLE4D_CONNECT"] = connect
        config = read_config(None, "client", environment)
        self.bus = ZenohBus(config, robot, connect_timeout_s=timeout_s)
        self.inbox = Inbox()

    @property
    def counters(self) -> dict[str, int]:
        """What came and what did not, by cause since the start.

        `received_people`; `gaps_people`: camera frames for which no people came, lost on the way or
        skipped by a busy detector; `dropped_people`: pushed out because nobody took them;
        `bad_people`: bytes that are no such message. Likewise for other streams.
        """
        return dict(self.inbox.counters)

    def messages(self, *kinds: type[M], timeout_s: float | None = None) -> Iterator[M]:
        """Subscribe, and yield messages as they come.

        Args:
            kinds: Types of message, for example Tracks.
            timeout_s: End when no message came for so long; None: wait for ever.
        """
        arrivals = self.arrivals(*kinds, timeout_s=timeout_s)
        return (arrival.message for arrival in arrivals if isinstance(arrival.message, kinds))

    def arrivals(self, *kinds: type[Message], timeout_s: float | None = None) -> Iterator[Arrival]:
        """Subscribe, and yield messages with the times at which they came.

        Args:
            kinds: Types of message.
            timeout_s: End when no message came for so long; None: wait for ever.
        """
        subscriptions = [self._subscribe(BY_MESSAGE[kind]) for kind in kinds]
        return self._yield(kinds, timeout_s, subscriptions)

    def _yield(
        self,
        kinds: tuple[type[Message], ...],
        timeout_s: float | None,
        subscriptions: list[Subscription],
    ) -> Iterator[Arrival]:
        waited_since = time.monotonic()
        try:
            while timeout_s is None or time.monotonic() - waited_since < timeout_s:
                # Short waits let Ctrl-C through.
                arrival = self.inbox.get(0.2 if timeout_s is None else min(timeout_s, 0.2))
                if arrival and isinstance(arrival.message, kinds):
                    yield arrival
                    waited_since = time.monotonic()
        finally:
            for subscription in subscriptions:
                subscription.close()

    def close(self) -> None:
        """Leave the network."""
        self.bus.close()

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _subscribe(self, topic: Topic) -> Subscription:
        subscription = self.bus.subscribe(topic)
        self.inbox.follow(subscription, topic)
        return subscription


def subscribe(connect: str = "", robot: str = "robot") -> Iterator[Tracks]:
    """Yield the people around a robot, one message for every camera frame.

        for people in subscribe("tcp/192.168.1.7:7447"):
            for person in people.people:
                print(person.id, person.position_m, person.velocity_mps, person.yaw_rad)

    Args:
        connect: Endpoint of the router; empty for the one on this host.
        robot: Name of the robot.

    Raises:
        People4dError: No router answers, or it refuses the credentials.
    """
    with Client(connect, robot) as client:
        yield from client.messages(Tracks)
