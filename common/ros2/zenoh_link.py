"""Zenoh session on the keys of ROS 2, used by the transport `rmw_zenoh`."""

import os
from collections.abc import Callable
from typing import Any

import zenoh
import zenoh.ext

from common.ros2.config import Ros2Config
from common.ros2.transport import Qos
from people4d import session
from people4d.errors import ConfigError
from people4d.session import ZenohSession
from people4d.subscription import ZenohSubscription

LOCAL = ("127.0.0.1", "localhost", "[::1]")

OnSample = Callable[[bytes, bytes | None, str], None]  # payload, attachment, key


def read_config(config: Ros2Config) -> zenoh.Config:
    """Return the configuration of Zenoh for the robot's own network, or for other endpoints.

    ConfigError if a file or environment variable of Zenoh's configuration is invalid.
    """
    if not config.endpoints:
        if os.environ.get("PEOPLE4D_KEYS"):
            raise ConfigError(
                "the robot's router admits only people4d roles, which ROS 2 nodes lack",
                "Run rmw_zenohd on another port, and set ros2.endpoints to it.",
            )
        return session.read_config(None, "peer")
    # Peers on other hosts cannot reach a loopback address; the router forwards for a client.
    local = all(any(host in endpoint for host in LOCAL) for endpoint in config.endpoints)
    environment = {"PEOPLE4D_CONNECT": ",".join(config.endpoints)}
    return session.read_config(session.CONFIGS, "peer" if local else "client", environment)


class ZenohLink(ZenohSession):
    """Publishes and receives bytes with attachments on any key, and declares liveliness tokens.

    ConfigError if an endpoint or a configuration file is invalid; People4dError if no session could
    be opened.
    """

    def __init__(self, config: Ros2Config) -> None:
        super().__init__(read_config(config), "ros2")
        self._tokens: list[Any] = []

    def publisher(self, key: str, qos: Qos) -> Any:
        """Declare a publisher; it caches messages for late joiners if it is transient local."""
        # a blocked consumer must not delay other consumers
        drop: Any = zenoh.CongestionControl.DROP
        if qos.durability == "volatile":
            return self._session.declare_publisher(key, congestion_control=drop, express=True)
        return zenoh.ext.declare_advanced_publisher(
            self._session,
            key,
            congestion_control=drop,
            express=True,
            cache=zenoh.ext.CacheConfig(max_samples=qos.depth),
            publisher_detection=True,
        )

    def receive(self, key: str, qos: Qos, on_sample: OnSample) -> None:
        """Call a function with each message of other sessions on a key, in a separate thread."""
        channel: Any = zenoh.handlers.RingChannel(max(qos.depth, 1))
        subscriber: Any
        others = zenoh.Locality.REMOTE
        if qos.durability == "volatile":
            subscriber = self._session.declare_subscriber(key, channel, allowed_origin=others)
        else:
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.depth)
            subscriber = zenoh.ext.declare_advanced_subscriber(
                self._session, key, channel, history=history, allowed_origin=others
            )
        subscription = self._keep(subscriber)
        self._start(lambda: _pass_on(subscription, on_sample), f"receive {key}")

    def declare_token(self, key: str) -> Callable[[], None]:
        """Declare a liveliness token, and return its withdrawal; `close` withdraws it, too."""
        token: Any = self._session.liveliness().declare_token(key)
        self._tokens.append(token)

        def withdraw() -> None:
            if token in self._tokens:
                self._tokens.remove(token)
                token.undeclare()

        return withdraw


def _pass_on(subscription: ZenohSubscription, on_sample: OnSample) -> None:
    for sample in subscription.samples():
        if sample.kind == zenoh.SampleKind.PUT:
            attachment = sample.attachment.to_bytes() if sample.attachment else None
            on_sample(sample.payload.to_bytes(), attachment, str(sample.key_expr))
