"""Topics of nodes that run with RMW_IMPLEMENTATION=rmw_zenoh_cpp.

Source: design document of rmw_zenoh (docs/design.md there).
"""

import hashlib
import itertools
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

from common.ros2 import types
from common.ros2.config import Ros2Config
from common.ros2.names import NodeTokens, TopicType
from common.ros2.transport import DEFAULT, Qos, Receive, Ros2Publisher, Ros2Sample, Ros2Transport
from common.ros2.zenoh_link import ZenohLink

# Sequence number, wall clock [ns], length of the publisher's identity, identity.
ATTACHMENT = struct.Struct("<qqB16s")


class RmwZenoh(Ros2Transport):
    """Node of ROS 2 on Zenoh, see `Ros2Transport`."""

    def __init__(self, config: Ros2Config) -> None:
        super().__init__()
        self._config = config
        self._link = ZenohLink(config)
        self._tokens = NodeTokens(
            config.domain_id, self._link.identity, config.namespace, config.node
        )
        self._numbers: Iterator[int] = itertools.count(1)
        self._link.declare_token(self._tokens.of_node())

    def publisher(self, topic: str, kind: str, qos: Qos = DEFAULT) -> Ros2Publisher:
        """Announce a topic, see `Ros2Transport.publisher`."""
        named = TopicType.from_names(self._config, topic, kind)
        token = self._tokens.of_publisher(next(self._numbers), named, qos)
        publisher = self._link.publisher(named.key(self._config.domain_id), qos)
        return RmwZenohPublisher(publisher, token, self._link.declare_token(token), self.counters)

    def subscribe(self, topic: str, kind: str, receive: Receive, qos: Qos = DEFAULT) -> None:
        """Receive a topic, see `Ros2Transport.subscribe`."""
        named = TopicType.from_names(self._config, topic, kind)
        # All types: messages of other types are counted.
        key = f"{self._config.domain_id}{named.topic}/*/*"
        ending = f"/{types.dds_name(kind)}/{named.hash}"

        def take(cdr: bytes, attachment: bytes | None, key: str) -> None:
            if not key.endswith(ending):
                self.counters["other_type"] += 1
            elif attachment is None or len(attachment) != ATTACHMENT.size:
                self.counters["no_attachment"] += 1
            else:
                self.deliver(receive, Ros2Sample(cdr, ATTACHMENT.unpack(attachment)[1]))

        self._link.receive(key, qos, take)
        self._link.declare_token(self._tokens.of_subscription(next(self._numbers), named, qos))

    def close(self) -> None:
        """Leave the network, see `Ros2Transport.close`."""
        self._link.close()


class RmwZenohPublisher(Ros2Publisher):
    """Publisher of one topic, announced by a token; it numbers its messages."""

    def __init__(
        self, publisher: Any, token: str, withdraw: Callable[[], None], counters: Counter[str]
    ) -> None:
        self._publisher, self._withdraw, self._counters = publisher, withdraw, counters
        # Derived from the token as in rmw_zenoh; only uniqueness is required.
        self._identity = hashlib.blake2b(token.encode(), digest_size=16).digest()
        self._numbers = itertools.count(1)

    def send(self, cdr: bytes) -> None:
        """Publish a message, see `Ros2Publisher.send`."""
        attachment = ATTACHMENT.pack(next(self._numbers), time.time_ns(), 16, self._identity)
        try:
            self._publisher.put(cdr, attachment=attachment)
        except Exception:  # for example from a closed session
            self._counters["send_errors"] += 1

    def close(self) -> None:
        """Leave the topic."""
        self._withdraw()
        self._publisher.undeclare()
