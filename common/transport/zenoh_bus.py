"""The bus between processes, on a Zenoh session that also publishes."""

import json
import os
import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import zenoh
import zenoh.ext

from common.transport.access import LOCAL_INTERFACES, access_control, downsampling, privacy_control
from common.transport.exchange import Exchange
from people4d import session
from people4d.codec import encode
from people4d.credentials import uses_certificates
from people4d.errors import ConfigError
from people4d.messages import Health, Message, RgbdFrame, Span
from people4d.session import ZenohSession, check_chunk
from people4d.subscription import ZenohSubscription
from people4d.topics import BY_MESSAGE, Topic, prefix, query_key

SLOW_HZ = "10"  # of each topic through $PEOPLE4D_SLOW_LINKS
QUERIES_MAX = 64  # that may wait for a reply
UNSURE_S = 1.0  # from the first message of a key, in which its subscribers may not all be known


def read_config(
    file: Path | None, default: str, environment: Mapping[str, str] | None = None, role: str = ""
) -> zenoh.Config:
    """Read the Zenoh configuration of a service, with access rules and limits of slow links.

    Args:
        file: The file, or a folder of one for each mode; None for $PEOPLE4D_ZENOH, else the
            shipped ones.
        default: Mode: "peer", which $PEOPLE4D_MODE overrides, "router" or "client".
        environment: Variables as in docs/launch/hosts.md; None for the process's own environment.
        role: Service that it is for; empty: $PEOPLE4D_ROLE.

    Raises:
        ConfigError: The file cannot be read or Zenoh refuses it.
    """
    environment = os.environ if environment is None else environment
    mode = (environment.get("PEOPLE4D_MODE") or default) if default == "peer" else default
    config = session.read_config(file, mode, environment, role)
    if not json.loads(config.get_json("access_control"))["enabled"]:
        rules = _access_rules(mode, environment)
        if rules:
            config.insert_json5("access_control", json.dumps(rules))
    slow = environment.get("PEOPLE4D_SLOW_LINKS")
    if slow and mode == "router":
        most = environment.get("PEOPLE4D_SLOW_HZ") or SLOW_HZ
        if not re.fullmatch(r"\d+(\.\d+)?", most):
            raise ConfigError(f"PEOPLE4D_SLOW_HZ: expected a number, got {most!r}")
        config.insert_json5("downsampling", json.dumps(downsampling(slow.split(","), float(most))))
    return config


def is_private(environment: Mapping[str, str]) -> bool:
    """Check that $PEOPLE4D_PRIVACY asks for no pixel to leave the host.

    Raises:
        ConfigError: Its value is neither on nor off.
    """
    text = environment.get("PEOPLE4D_PRIVACY", "")
    if text not in ("", "off", "on"):
        raise ConfigError(f"PEOPLE4D_PRIVACY: expected on or off, got {text!r}")
    return text == "on"


def _access_rules(mode: str, environment: Mapping[str, str]) -> dict[str, Any] | None:
    """Return the rules that a process enforces, None if it cannot or need not."""
    names = environment.get("PEOPLE4D_LOCAL_INTERFACES", "").split(",")
    local = [name for name in names if name] or list(LOCAL_INTERFACES)
    private, keys = is_private(environment), environment.get("PEOPLE4D_KEYS")
    if keys and uses_certificates(Path(keys)) and mode != "client":
        # Both ends prove their role, so peers let in only those that may use their topics.
        return access_control("cert_common_names", local, private)
    if keys and not uses_certificates(Path(keys)) and mode == "router":
        # Only the end that connects proves its role by a password, so only the router can enforce.
        return access_control("usernames", local, private)
    return privacy_control(local) if private else None


@dataclass(frozen=True)
class Member:
    """A process of a service that joined or left."""

    instance: str  # its name
    present: bool  # True if it joined


class ZenohMembers:
    """Processes of one service as they join and leave; iterate in a thread of its own."""

    def __init__(self, tokens: ZenohSubscription) -> None:
        self._tokens = tokens

    def __iter__(self) -> Iterator[Member]:
        """Yield the present ones, then changes, until closed."""
        for sample in self._tokens.samples():
            instance = str(sample.key_expr).rpartition("/")[2]
            yield Member(instance, sample.kind == zenoh.SampleKind.PUT)

    def close(self) -> None:
        """End the iteration."""
        self._tokens.close()


@dataclass(frozen=True)
class _Publisher:
    """Publisher of one key."""

    declared: Any  # of Zenoh
    always: bool  # it sends without subscribers, too: late joiners get the last message
    since_s: float  # monotonic time of its declaration

    def is_wanted(self, now_s: float) -> bool:
        """Check whether another session subscribes to the key, as far as that is known."""
        if self.always or now_s - self.since_s < UNSURE_S:
            return True
        matching: bool = self.declared.matching_status.matching
        return matching

    def put(self, payload: bytes) -> None:
        """Send."""
        self.declared.put(payload)


class ZenohBus(ZenohSession):
    """Publishes and subscribes through one Zenoh session.

    Args:
        config: Zenoh configuration.
        robot: Name of the robot, third chunk of every key.
        connect_timeout_s: Longest wait for a router in client mode.
        exchange: Of the services that share this session: it hands messages between them, and
            Zenoh only to others; None: Zenoh also delivers to the subscriptions of this session.

    Raises:
        ConfigError: The name of the robot cannot be part of a key.
        People4dError: No session: nothing listens at the endpoint, or it refuses the credentials.
    """

    def __init__(
        self,
        config: zenoh.Config,
        robot: str,
        connect_timeout_s: float = 0.0,
        exchange: Exchange | None = None,
    ) -> None:
        super().__init__(config, robot, connect_timeout_s)
        self.exchange = exchange
        self._publishers: dict[str, _Publisher] = {}
        self._tokens: dict[str, Any] = {}
        self._lock = threading.Lock()

    def publish(self, message: Message, publishing: Callable[[], Span] | None = None) -> None:
        """Send a message on the key that the topic table gives it.

        Args:
            message: The message.
            publishing: Gives the last stage of its trace, called when it is encoded.
        """
        self.hand_over(message, publishing)
        self.send(message, publishing)

    def hand_over(self, message: Message, publishing: Callable[[], Span] | None) -> None:
        """Give a message to the subscribers in this process, if services share it."""
        if not self.exchange:
            return
        topic = BY_MESSAGE[type(message)]
        trace = (*message.trace, publishing()) if publishing else message.trace
        key = topic.key_of(message, self.robot)
        self.exchange.publish(topic, key, msgspec.structs.replace(message, trace=trace))

    def send(self, message: Message, publishing: Callable[[], Span] | None) -> None:
        """Send a message to other processes; among shared services only if one subscribes."""
        topic = BY_MESSAGE[type(message)]
        lossless = (isinstance(message, RgbdFrame) and message.lockstep) or (
            isinstance(message, Health) and message.state == "stopping"
        )
        publisher = self._publisher(topic, topic.key_of(message, self.robot), lossless)
        if not self.exchange or publisher.is_wanted(time.monotonic()):
            publisher.put(encode(message, publishing))

    def subscribe(self, topic: Topic, own: bool = True) -> ZenohSubscription:
        """Receive a topic as `ZenohSession.subscribe` does; through Zenoh only what others send.

        What this session publishes comes through the exchange, if there is one.
        """
        return super().subscribe(topic, own and self.exchange is None)

    def announce(self, service: str, instance: str) -> None:
        """Declare a liveliness token: it vanishes when this process does."""
        check_chunk("instance", instance)
        key = f"{prefix(self.robot)}/alive/{service}/{instance}"
        self._tokens[service] = self._session.liveliness().declare_token(key)

    def withdraw(self, service: str) -> None:
        """Take the liveliness token of a service back."""
        token = self._tokens.pop(service, None)
        if token:
            token.undeclare()

    def members(self, service: str) -> ZenohMembers:
        """Receive the liveliness tokens of a service."""
        key = f"{prefix(self.robot)}/alive/{service}/*"
        # A queue that is read at once: a ring would lose members.
        channel: Any = zenoh.handlers.FifoChannel(256)
        subscriber = self._session.liveliness().declare_subscriber(key, channel, history=True)
        return ZenohMembers(self._keep(subscriber))

    def serve(self, name: str, reply: Callable[[], bytes]) -> None:
        """Reply to every query of a name, in a thread of its own."""
        key = query_key(self.robot, name)
        channel: Any = zenoh.handlers.RingChannel(QUERIES_MAX)
        queries = self._keep(self._session.declare_queryable(key, channel))

        def send_replies() -> None:
            for query in queries.samples():
                with query:
                    query.reply(key, reply())

        self._start(send_replies, name)

    def _publisher(self, topic: Topic, key: str, lossless: bool) -> "_Publisher":
        name = f"{key}{'!' if lossless else ''}"
        with self._lock:
            if name not in self._publishers:
                declared = self._declare(topic, key, lossless)
                always = topic.delivery == "latched"
                self._publishers[name] = _Publisher(declared, always, time.monotonic())
            return self._publishers[name]

    def _declare(self, topic: Topic, key: str, lossless: bool) -> Any:
        # A slow link must not hold up live frames, and nothing a heartbeat but the last one;
        # everything else is small enough to wait for.
        wait = lossless or (topic.delivery != "newest" and topic.message is not Health)
        control = zenoh.CongestionControl.BLOCK if wait else zenoh.CongestionControl.DROP
        to = zenoh.Locality.REMOTE if self.exchange else zenoh.Locality.ANY
        if topic.delivery == "latched":
            return zenoh.ext.declare_advanced_publisher(
                self._session,
                key,
                congestion_control=control,
                allowed_destination=to,
                cache=zenoh.ext.CacheConfig(max_samples=1),
                publisher_detection=True,
                # Numbers its messages, since sessions do not stamp them.
                sample_miss_detection=zenoh.ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=None
                ),
            )
        return self._session.declare_publisher(
            key, congestion_control=control, express=True, allowed_destination=to
        )
