"""The bus between processes, on a Zenoh session that also publishes."""

import contextlib
import json
import os
import threading
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import zenoh
import zenoh.ext

from common.transport.access import LOCAL_INTERFACES, access_control, privacy_control
from common.transport.exchange import Exchange
from common.transport.zenoh_publisher import Publisher
from people4d import session
from people4d.codec import encode
from people4d.credentials import uses_certificates
from people4d.errors import ConfigError
from people4d.messages import Message, Span
from people4d.ownership import FOREIGN
from people4d.session import ZenohSession, check_chunk
from people4d.subscription import ZenohSubscription, session_of
from people4d.topics import BY_MESSAGE, Topic, prefix, query_key

QUERIES_MAX = 64  # maximum number of waiting queries
REPEAT_S = 2.0  # period of the repetitions of a latched message [s]


def read_config(
    file: Path | None, default: str, environment: Mapping[str, str] | None = None, role: str = ""
) -> zenoh.Config:
    """Read the Zenoh configuration of a service, with its access rules.

    ConfigError if the file cannot be read or Zenoh refuses it.

    Args:
        file: A file, or a folder with a file for each mode. None: $PEOPLE4D_ZENOH, or the shipped
            folder if that is unset.
        default: Mode "peer", "router" or "client"; $PEOPLE4D_MODE overrides "peer".
        environment: Variables as in docs/launch/hosts.md. None: the environment of the process.
        role: Role of the service; empty: $PEOPLE4D_ROLE.
    """
    environment = os.environ if environment is None else environment
    mode = (environment.get("PEOPLE4D_MODE") or default) if default == "peer" else default
    config = session.read_config(file, mode, environment, role)
    if not json.loads(config.get_json("access_control"))["enabled"]:
        rules = _access_rules(mode, environment)
        if rules:
            config.insert_json5("access_control", json.dumps(rules))
    return config


def is_private(environment: Mapping[str, str]) -> bool:
    """Check that no pixel may leave the host; ConfigError if $PEOPLE4D_PRIVACY is not on or off."""
    text = environment.get("PEOPLE4D_PRIVACY", "")
    if text not in ("", "off", "on"):
        raise ConfigError(f"PEOPLE4D_PRIVACY: expected on or off, got {text!r}")
    return text == "on"


def _access_rules(mode: str, environment: Mapping[str, str]) -> dict[str, Any] | None:
    """Return the rules that a process enforces, None if there are none."""
    names = environment.get("PEOPLE4D_LOCAL_INTERFACES", "").split(",")
    local = [name for name in names if name] or list(LOCAL_INTERFACES)
    private, keys = is_private(environment), environment.get("PEOPLE4D_KEYS")
    if keys and uses_certificates(Path(keys)) and mode != "client":
        # Both ends prove their role, so peers admit only roles with access to their topics.
        return access_control("cert_common_names", local, private)
    if keys and not uses_certificates(Path(keys)) and mode == "router":
        # Only the connecting end proves its role by a password, so only the router enforces rules.
        return access_control("usernames", local, private)
    return privacy_control(local) if private else None


class ZenohBus(ZenohSession):
    """Publishes and subscribes through one Zenoh session.

    ConfigError if the name of the robot cannot be part of a key; People4dError if
    nothing listens at the endpoint, or it refuses the credentials.

    Args:
        config: Zenoh configuration.
        robot: Name of the robot, third chunk of every key.
        connect_timeout_s: Longest wait for a router in client mode.
        exchange: Exchange between the services of this session, with Zenoh for other processes
            only; None: Zenoh delivers to this session, too.
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
        self._publishers: dict[str, Publisher] = {}
        self._tokens: dict[str, list[Any]] = {}
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._guarded: list[Topic] = []
        # Number of forged messages in the name of this session
        self.counters: Counter[str] = Counter()

    def publish(self, message: Message, publishing: Callable[[], Span] | None = None) -> None:
        """Send a message on its key in the topic table.

        Args:
            message: Message to send.
            publishing: Returns the last stage of its trace, called when it is encoded.
        """
        self.hand_over(message, publishing)
        self.send(message, publishing)

    def hand_over(self, message: Message, publishing: Callable[[], Span] | None) -> None:
        """Pass a message to the subscribers in this process, if services share it."""
        if not self.exchange:
            return
        topic = BY_MESSAGE[type(message)]
        trace = (*message.trace, publishing()) if publishing else message.trace
        key = topic.key_of(message, self.robot)
        self.exchange.publish(topic, key, msgspec.structs.replace(message, trace=trace))

    def send(self, message: Message, publishing: Callable[[], Span] | None) -> None:
        """Send a message to other processes; with an exchange only if one subscribes."""
        topic = BY_MESSAGE[type(message)]
        key = topic.key_of(message, self.robot)
        publisher = self._publisher(topic, key, topic.is_lossless(message))
        if not self.exchange or publisher.is_wanted():
            payload = encode(message, publishing)
            if topic.owned and self.exchange:
                self._announcements.own[key] = (self.identity, payload)
            publisher.send(payload)

    def subscribe(self, topic: Topic, own: bool = True) -> ZenohSubscription:
        """Receive a topic as `ZenohSession.subscribe` does.

        With an exchange, messages of this session come through it, not through Zenoh.
        """
        return super().subscribe(topic, own and self.exchange is None)

    def announce(self, service: str, instance: str) -> None:
        """Declare a liveliness token: it vanishes when this process does."""
        check_chunk("instance", instance)
        key = f"{prefix(self.robot)}/alive/{service}/{instance}"
        liveliness, session = self._session.liveliness(), f"{key}/{self.identity}"
        self._tokens[service] = [liveliness.declare_token(one) for one in (key, session)]
        self._announcements.update_token(session, is_present=True)

    def withdraw(self, service: str) -> None:
        """Withdraw the liveliness tokens of a service."""
        for token in self._tokens.pop(service, ()):
            token.undeclare()

    def close(self) -> None:
        """End all subscriptions and leave the network."""
        self._closing.set()
        super().close()

    def members(self, service: str) -> ZenohSubscription:
        """Receive the liveliness tokens of a service."""
        return self._tokens_of(f"{prefix(self.robot)}/alive/{service}/*")

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

    def _publisher(self, topic: Topic, key: str, lossless: bool) -> Publisher:
        name = f"{key}{'!' if lossless else ''}"
        to = zenoh.Locality.REMOTE if self.exchange else zenoh.Locality.ANY
        with self._lock:
            if name not in self._publishers:
                self._publishers[name] = Publisher(self._session, topic, key, lossless, to)
            if topic.delivery == "latched" and self._tokens and topic not in self._guarded:
                self._guarded.append(topic)
                self._start(lambda: self._guard(topic), f"guard {topic.name}")
                if len(self._guarded) == 1:
                    self._start(self._repeat, "repeat")
            return self._publishers[name]

    def _repeat(self) -> None:
        """Repeat latched messages, for subscribers that read a forged message meanwhile."""
        while not self._closing.wait(REPEAT_S):
            with self._lock:
                publishers = list(self._publishers.values()) if self._tokens else []
            with contextlib.suppress(zenoh.ZError):  # the session was closed
                for publisher in publishers:
                    publisher.repeat()

    def _guard(self, topic: Topic) -> None:
        """Count messages of other sessions in the name of this session."""
        channel: Any = zenoh.handlers.RingChannel(QUERIES_MAX)
        key, origin = topic.key_expression(self.robot), zenoh.Locality.REMOTE
        with contextlib.suppress(zenoh.ZError):  # the session was closed
            others = self._session.declare_subscriber(key, channel, allowed_origin=origin)
            for sample in self._keep(others).samples():
                publisher = self._publishers.get(str(sample.key_expr))
                if publisher and session_of(sample) == self.identity:
                    publisher.is_copied = True
                    self.counters[f"{FOREIGN}_{topic.name}"] += 1
