"""Publisher of an output, at its rate."""

import struct
from collections import Counter

from common.ros2 import types
from common.ros2.transport import DEFAULT, Qos, Ros2Transport
from common.ros2.types import Fields
from services.ros2_bridge.config import OutputConfig

EARLY = 0.1  # maximum earliness of a message, as a share of the period, since stamps jitter


class Ros2Output:
    """Publisher of one type of message.

    Args:
        transport: Node of ROS 2 of the topic.
        config: Topic and rate.
        kind: Type, for example "people_msgs/msg/People".
        counters: Sent messages (ros2_sent), and messages that ROS cannot hold (ros2_unfit).
        qos: Quality of service.

    Raises:
        ConfigError: ROS has no such name.
    """

    def __init__(
        self,
        transport: Ros2Transport,
        config: OutputConfig,
        kind: str,
        counters: Counter[str],
        qos: Qos = DEFAULT,
    ) -> None:
        self._kind, self._counters = kind, counters
        self._period_ns = round(1e9 / config.rate_max_hz) if config.rate_max_hz else 0
        self._sent_ns: int | None = None
        self._publisher = transport.publisher(config.topic, kind, qos)
        counters.update(ros2_sent=0, ros2_unfit=0)
        types.encode(kind, {})  # compiles the type before the first message

    def is_due(self, time_ns: int) -> bool:
        """Return True, and count the message as sent, if a message at this time is due."""
        before_ns = self._sent_ns
        if before_ns is not None and 0 <= time_ns - before_ns < (1 - EARLY) * self._period_ns:
            return False
        self._sent_ns = time_ns
        return True

    def send(self, fields: Fields) -> None:
        """Publish a message, or count it if a number is too large for its type."""
        try:
            cdr = types.encode(self._kind, fields)
        except (ValueError, OverflowError, struct.error):
            self._counters["ros2_unfit"] += 1
            return
        self._publisher.send(cdr)
        self._counters["ros2_sent"] += 1

    def close(self) -> None:
        """Leave the topic."""
        self._publisher.close()
