"""The bus between processes: the only module that meets Zenoh."""

import json
import os
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import zenoh
import zenoh.ext

import people4d
from common.transport import credentials
from common.transport.access import downsampling
from common.transport.bus import Member
from people4d.codec import encode
from people4d.errors import ConfigError, People4dError
from people4d.messages import Message, RgbdFrame, Span
from people4d.messages.base import check_name
from people4d.topics import BY_MESSAGE, LOCKSTEP_MAX, Topic, prefix, question

# What names the machine that Zenoh was built on tells a user nothing.
BUILD_PATH = re.compile(r" at /[^ ]*\.rs:\d+\.?")

CONFIGS = Path(people4d.__file__).parent / "zenoh"
CLOSE_S = 2.0
SLOW_HZ = "10"  # of each topic through $PEOPLE4D_SLOW_LINKS
ANSWER_S = 2.0
QUESTIONS = 64  # that may wait for an answer
ENCRYPTED = ("tls", "quic")
UNFIT = {("connect", "router"), ("listen", "client")}


def read_config(
    file: Path | None, default: str, environment: Mapping[str, str] | None = None, role: str = ""
) -> zenoh.Config:
    """Read a Zenoh configuration (Zenoh's own JSON5).

    Args:
        file: The file, or a folder of one for each role; None for $PEOPLE4D_ZENOH, else the
            shipped ones.
        default: Mode, which names the file in a folder: "peer", "router" or "client".
        environment: PEOPLE4D_CONNECT and PEOPLE4D_LISTEN (endpoints, comma-separated) win over the
            file, so that one file serves every host; the others are in docs/hosts.md; None for
            the process's own environment.
        role: Service that it is for; empty: $PEOPLE4D_ROLE, which a client needs where its folder
            of keys holds several.

    Raises:
        ConfigError: The file cannot be read or Zenoh refuses it.
    """
    environment = os.environ if environment is None else environment
    if default == "peer":
        default = environment.get("PEOPLE4D_MODE") or default
    path = file or Path(environment.get("PEOPLE4D_ZENOH") or CONFIGS)
    path = path / f"{default}.json5" if path.is_dir() else path
    try:
        config = zenoh.Config.from_file(str(path))
        for name in ("connect", "listen"):
            endpoints = environment.get(f"PEOPLE4D_{name.upper()}")
            # Where the variables are set for all processes of a host, a router must not call
            # itself and a client must not take the router's port.
            if endpoints and (name, default) not in UNFIT:
                config.insert_json5(f"{name}/endpoints", json.dumps(endpoints.split(",")))
        _secure(config, default, environment, role or environment.get("PEOPLE4D_ROLE", ""))
    except zenoh.ZError as error:
        raise ConfigError(f"Zenoh configuration {path} is not usable: {_told(error)}") from error
    return config


def _secure(config: zenoh.Config, mode: str, environment: Mapping[str, str], role: str) -> None:
    """Insert credentials and access rules, and what slow links can carry."""
    keys = environment.get("PEOPLE4D_KEYS")
    if keys:
        here = environment.get("PEOPLE4D_HERE", "")
        own_rules = json.loads(config.get_json("access_control"))["enabled"]
        for path, value in credentials.settings(Path(keys), mode, role, here).items():
            if path != "access_control" or not own_rules:
                config.insert_json5(path, json.dumps(value))
        if credentials.uses_certificates(Path(keys)):
            _encrypt(config)
    slow = environment.get("PEOPLE4D_SLOW_LINKS")
    if slow and mode == "router":
        most = environment.get("PEOPLE4D_SLOW_HZ") or SLOW_HZ
        if not re.fullmatch(r"\d+(\.\d+)?", most):
            raise ConfigError(f"PEOPLE4D_SLOW_HZ: expected a number, got {most!r}")
        config.insert_json5("downsampling", json.dumps(downsampling(slow.split(","), float(most))))


def _encrypt(config: zenoh.Config) -> None:
    """Let every link be encrypted."""
    for path in ("connect/endpoints", "listen/endpoints"):
        endpoints = config.get_json(path).replace('"tcp/', '"tls/')
        for protocol in re.findall(r'"([\w-]+)/', endpoints):
            if protocol not in ENCRYPTED:
                raise ConfigError(
                    f"{path}: {protocol} is not encrypted, but PEOPLE4D_KEYS holds certificates",
                    "Use tcp/ (which becomes tls/), tls/ or quic/.",
                )
        config.insert_json5(path, endpoints)


def _told(error: zenoh.ZError) -> str:
    text = " ".join(BUILD_PATH.sub("", str(error)).split())
    inner = re.search(r'Message { msg: "(.*)", location', text)
    return inner[1] if inner else text


def _check_chunk(field: str, name: str) -> None:
    try:
        check_name(field, name)
    except ValueError as error:
        raise ConfigError(str(error)) from error


def _open(config: zenoh.Config) -> zenoh.Session:
    endpoints = config.get_json("connect/endpoints")
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        if "listener" in str(error):
            raise People4dError(
                f"Zenoh cannot listen ({_told(error)})",
                "Does another router run on this host (people4d ps)? Else take another port "
                "(people4d up --port, or PEOPLE4D_LISTEN).",
            ) from error
        raise People4dError(
            f"no Zenoh session with {endpoints} ({_told(error)})",
            "Is the system up (people4d ps), the endpoint right (--connect), and do user, "
            "password or certificates match the router's?",
        ) from error


class ZenohSubscription:
    """Payloads of one topic; iterate in a thread of its own."""

    def __init__(self, subscriber: Any) -> None:
        self._subscriber = subscriber
        self._closed = False
        self._receiving = threading.Lock()

    def __iter__(self) -> Iterator[tuple[str, bytes]]:
        """Yield key and payload until closed."""
        for sample in self.samples():
            if sample.kind == zenoh.SampleKind.PUT:
                yield str(sample.key_expr), sample.payload.to_bytes()

    def samples(self) -> Iterator[Any]:
        """Yield all that comes, as Zenoh gives it, until closed."""
        while not self._closed:
            try:
                with self._receiving:
                    sample = self._subscriber.handler.recv()
            except zenoh.ZError:
                return
            yield sample

    def close(self) -> None:
        """End the iteration."""
        if not self._closed:
            self._closed = True
            self._subscriber.undeclare()
            # Python aborts if it ends while a thread is still inside of Zenoh.
            if self._receiving.acquire(timeout=CLOSE_S):
                self._receiving.release()


class ZenohMembers:
    """Processes of one service as they come and go; iterate in a thread of its own."""

    def __init__(self, subscriber: Any) -> None:
        self._samples = ZenohSubscription(subscriber)

    def __iter__(self) -> Iterator[Member]:
        """Yield those that are there, then changes, until closed."""
        for sample in self._samples.samples():
            *_, instance, capacity = str(sample.key_expr).split("/")
            if capacity.isdecimal():
                yield Member(instance, int(capacity), sample.kind == zenoh.SampleKind.PUT)

    def close(self) -> None:
        """End the iteration."""
        self._samples.close()


class ZenohBus:
    """Publishes and subscribes through one Zenoh session.

    Args:
        config: Zenoh configuration.
        robot: Name of the robot, third chunk of every key.
        connect_timeout_s: Longest wait for a router in client mode.

    Raises:
        ConfigError: The name of the robot cannot be part of a key.
        People4dError: No session: nobody listens at the endpoint, or it refuses the credentials.
    """

    def __init__(self, config: zenoh.Config, robot: str, connect_timeout_s: float = 0.0) -> None:
        _check_chunk("robot", robot)
        self.robot = robot
        self._publishers: dict[str, Any] = {}
        self._subscriptions: list[ZenohSubscription] = []
        self._members: list[ZenohMembers] = []
        self._token: Any = None
        self._threads: list[threading.Thread] = []
        self._lock = threading.Lock()
        zenoh.init_log_from_env_or("error")
        if connect_timeout_s:
            config.insert_json5("connect/timeout_ms", str(int(connect_timeout_s * 1000)))
            config.insert_json5("connect/exit_on_failure", "true")
        self._session = _open(config)

    def publish(self, message: Message, publishing: Callable[[], Span] | None = None) -> None:
        """Send a message on the key that the topic table gives it.

        Args:
            message: The message.
            publishing: Gives the last stage of its trace, asked when it is encoded.
        """
        topic = BY_MESSAGE[type(message)]
        key = topic.key_of(message, self.robot)
        lossless = isinstance(message, RgbdFrame) and message.lockstep
        publisher = self._publisher(topic, key, lossless)
        publisher.put(encode(message, publishing))

    def subscribe(self, topic: Topic, own: bool = True) -> ZenohSubscription:
        """Receive a topic; of a latched one the last message of each key comes first.

        Args:
            topic: The topic.
            own: Whether what this session publishes itself comes, too.
        """
        key = topic.key_expression(self.robot)
        channel: Any = zenoh.handlers.RingChannel(
            LOCKSTEP_MAX if topic.delivery == "newest" else topic.depth
        )
        subscriber: Any
        if topic.delivery == "latched":
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
            subscriber = zenoh.ext.declare_advanced_subscriber(
                self._session, key, channel, history=history
            )
        else:
            origin = zenoh.Locality.ANY if own else zenoh.Locality.REMOTE
            subscriber = self._session.declare_subscriber(key, channel, allowed_origin=origin)
        subscription = ZenohSubscription(subscriber)
        self._subscriptions.append(subscription)
        return subscription

    def announce(self, service: str, instance: str, capacity: int = 1) -> None:
        """Declare a liveliness token: it vanishes when this process does."""
        _check_chunk("instance", instance)
        key = f"{prefix(self.robot)}/alive/{service}/{instance}/{capacity}"
        self._token = self._session.liveliness().declare_token(key)

    def withdraw(self) -> None:
        """Take the liveliness token back."""
        if self._token:
            self._token.undeclare()
            self._token = None

    def members(self, service: str) -> ZenohMembers:
        """Receive the liveliness tokens of a service."""
        key = f"{prefix(self.robot)}/alive/{service}/*/*"
        # A queue that is read at once: a ring would forget who is there.
        channel: Any = zenoh.handlers.FifoChannel(256)
        subscriber = self._session.liveliness().declare_subscriber(key, channel, history=True)
        members = ZenohMembers(subscriber)
        self._members.append(members)
        return members

    def present(self) -> list[tuple[str, str, str]]:
        """Return robot, service and instance of every process that is there, of all robots."""
        channel: Any = zenoh.handlers.FifoChannel(256)
        key = f"{prefix('*')}/alive/*/*/*"
        replies = self._session.liveliness().get(key, channel, timeout=ANSWER_S)
        keys = sorted({str(reply.ok.key_expr) for reply in replies if reply.ok})
        parts = (key.split("/") for key in keys)
        return [(robot, service, instance) for *_, robot, _, service, instance, _ in parts]

    def ask(self, name: str, heard: Callable[[bytes], None]) -> None:
        """Put a question; `heard` gets the answer in another thread, or is never called."""
        channel: Any = zenoh.handlers.FifoChannel(1)
        replies = self._session.get(question(self.robot, name), channel, timeout=ANSWER_S)

        def take() -> None:
            for reply in replies:
                if reply.ok:
                    heard(reply.ok.payload.to_bytes())

        self._start(take, f"ask {name}")

    def answer(self, name: str, reply: Callable[[], bytes]) -> None:
        """Answer a question whenever it is put, in a thread of its own."""
        key = question(self.robot, name)
        channel: Any = zenoh.handlers.RingChannel(QUESTIONS)
        queries = ZenohSubscription(self._session.declare_queryable(key, channel))
        self._subscriptions.append(queries)

        def serve() -> None:
            for query in queries.samples():
                with query:
                    query.reply(key, reply())

        self._start(serve, name)

    def _start(self, work: Callable[[], None], name: str) -> None:
        """Run what meets Zenoh in a thread of its own, which has ended when `close` returns."""
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        self._threads.append(threading.Thread(target=work, name=name, daemon=True))
        self._threads[-1].start()

    def close(self) -> None:
        """End all subscriptions and leave the network."""
        closing: list[ZenohSubscription | ZenohMembers] = [*self._subscriptions, *self._members]
        for subscription in closing:
            subscription.close()
        self._session.close()  # type: ignore[no-untyped-call]
        # Python aborts if it ends while a thread is still inside of Zenoh.
        for thread in self._threads:
            thread.join(CLOSE_S)

    def _publisher(self, topic: Topic, key: str, lossless: bool) -> Any:
        name = f"{key}{'!' if lossless else ''}"
        with self._lock:
            if name not in self._publishers:
                self._publishers[name] = self._declare(topic, key, lossless)
            return self._publishers[name]

    def _declare(self, topic: Topic, key: str, lossless: bool) -> Any:
        # A slow link must not hold up live frames; everything else is small enough to wait for.
        wait = lossless or topic.delivery != "newest"
        control = zenoh.CongestionControl.BLOCK if wait else zenoh.CongestionControl.DROP
        if topic.delivery == "latched":
            return zenoh.ext.declare_advanced_publisher(
                self._session,
                key,
                congestion_control=control,
                cache=zenoh.ext.CacheConfig(max_samples=1),
                publisher_detection=True,
                # Numbers its messages, since sessions do not stamp them.
                sample_miss_detection=zenoh.ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=None
                ),
            )
        return self._session.declare_publisher(key, congestion_control=control, express=True)
