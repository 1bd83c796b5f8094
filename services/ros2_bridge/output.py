"""Publishers of the outputs, each at its rate."""

import struct
from collections import Counter
from dataclasses import dataclass

from common.ros2 import types
from common.ros2.transport import DEFAULT, Qos, Ros2Transport, Send
from common.ros2.types import Fields
from services.ros2_bridge.config import Output, Ros2BridgeConfig

EARLY = 0.1  # share of a period by which a message may come early, since stamps jitter


@dataclass(frozen=True)
class Ros2Outputs:
    """Opens the configured outputs.

    Attributes:
        config: Published outputs, their topics and rates.
        transport: Node of ROS 2 of the topics.
        counters: Sent messages (ros2_sent), and messages that ROS cannot hold (ros2_unfit).
    """

    config: Ros2BridgeConfig
    transport: Ros2Transport
    counters: Counter[str]

    def open_output(
        self, output: Output, kind: str, suffix: str = "", qos: Qos = DEFAULT
    ) -> "Ros2Output | None":
        """Announce the topic of an output; None if it is not configured.

        Args:
            output: Name in the configuration.
            kind: Type, for example "people_msgs/msg/People".
            suffix: End of the topic's name; all messages of such a topic are sent.
            qos: Quality of service.

        Raises:
            ConfigError: ROS has no such name.
        """
        if output not in self.config.publish:
            return None
        send = self.transport.publisher(self.config.topic(output) + suffix, kind, qos)
        rate_hz = 0.0 if suffix else self.config.rate_max_hz(output)
        return Ros2Output(send, kind, rate_hz, self.counters)


class Ros2Output:
    """Publisher of one type of message, at most at a rate [Hz] (0: all messages)."""

    def __init__(self, send: Send, kind: str, rate_hz: float, counters: Counter[str]) -> None:
        self._send, self._kind, self._counters = send, kind, counters
        self._period_ns = round(1e9 / rate_hz) if rate_hz else 0
        self._sent_ns: int | None = None
        counters.update(ros2_sent=0, ros2_unfit=0)
        types.encode(kind, {})  # compiles the type, which the first message must not wait for

    def is_due(self, time_ns: int) -> bool:
        """Check that a message of this time is due, and if so, count it as sent."""
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
        self._send(cdr)
        self._counters["ros2_sent"] += 1
