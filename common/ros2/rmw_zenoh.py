"""Topics of nodes that run with RMW_IMPLEMENTATION=rmw_zenoh_cpp.

Source: design document of rmw_zenoh (docs/design.md there).
"""

import hashlib
import itertools
import struct
import time
from collections.abc import Iterator

from common.ros2 import types
from common.ros2.config import Ros2Config
from common.ros2.names import NodeTokens, TopicType
from common.ros2.transport import DEFAULT, Qos, Receive, Ros2Sample, Ros2Transport, Send
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

    def publisher(self, topic: str, kind: str, qos: Qos = DEFAULT) -> Send:
        """Announce a topic, see `Ros2Transport.publisher`."""
        named = TopicType.from_config(self._config, topic, kind)
        token = self._tokens.of_publisher(next(self._numbers), named, qos)
        publisher = self._link.publisher(named.key(self._config.domain_id), qos)
        self._link.declare_token(token)
        # rmw_zenoh also derives the identity from the token; it only has to be unique.
        identity = hashlib.blake2b(token.encode(), digest_size=16).digest()
        numbers = itertools.count(1)

        def send(cdr: bytes) -> None:
            attachment = ATTACHMENT.pack(next(numbers), time.time_ns(), 16, identity)
            try:
                publisher.put(cdr, attachment=attachment)
            except Exception:  # for example of a closed session
                self.counters["send_errors"] += 1

        return send

    def subscribe(self, topic: str, kind: str, receive: Receive, qos: Qos = DEFAULT) -> None:
        """Receive a topic, see `Ros2Transport.subscribe`."""
        named = TopicType.from_config(self._config, topic, kind)
        # All types, so that messages of other types are counted.
        key = f"{self._config.domain_id}{named.topic}/*/*"
        ending = f"/{types.dds_name(kind)}/{named.hash}"

        def on_sample(cdr: bytes, attachment: bytes | None, key: str) -> None:
            if not key.endswith(ending):
                self.counters["other_type"] += 1
            elif attachment is None or len(attachment) != ATTACHMENT.size:
                self.counters["no_attachment"] += 1
            else:
                self.deliver(receive, Ros2Sample(cdr, ATTACHMENT.unpack(attachment)[1]))

        self._link.receive(key, qos, on_sample)
        self._link.declare_token(self._tokens.of_subscription(next(self._numbers), named, qos))

    def close(self) -> None:
        """Leave the network, see `Ros2Transport.close`."""
        self._link.close()
