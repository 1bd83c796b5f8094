"""Zenoh sessions of a robot's network: configuration, credentials and subscriptions."""

import contextlib
import ctypes
import json
import math
import os
import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import zenoh
import zenoh.ext

from people4d import credentials
from people4d.errors import ConfigError, People4dError
from people4d.messages.base import check_name
from people4d.queue import RefusedPayload
from people4d.topics import IMAGE_MAX_BYTES, KEYS_MAX, LOCKSTEP_MAX, Topic, prefix, query_key

BUILD_PATH = re.compile(r" at /[^ ]*\.rs:\d+\.?")  # of the machine that Zenoh was built on

CONFIGS = Path(__file__).parent / "zenoh"
CLOSE_S = 2.0
ANSWER_S = 2.0
REPORT_S = 0.1  # between two reports of messages on too many keys
KEY_FORGOTTEN_S = 10.0  # without a message, after which a key makes room for another
ENCRYPTED = ("tls", "quic")
IGNORED = {("connect", "router"), ("listen", "client")}


def read_config(
    file: Path | None, default: str, environment: Mapping[str, str] | None = None, role: str = ""
) -> zenoh.Config:
    """Read a Zenoh configuration (Zenoh's own JSON5) and insert endpoints and credentials.

    Args:
        file: The file, or a folder of one for each mode; None for $PEOPLE4D_ZENOH, else the
            shipped ones.
        default: Mode, which names the file in a folder: "peer", "router", "client" or "area".
        environment: PEOPLE4D_CONNECT and PEOPLE4D_LISTEN (endpoints, comma-separated) win over the
            file, so that one file serves every host; the others are in docs/launch/hosts.md;
            None for the process's own environment.
        role: Role to prove; empty: $PEOPLE4D_ROLE, which a client needs where its folder of keys
            holds several.

    Raises:
        ConfigError: The file cannot be read or Zenoh refuses it.
    """
    environment = os.environ if environment is None else environment
    path = file or Path(environment.get("PEOPLE4D_ZENOH") or CONFIGS)
    path = path / f"{default}.json5" if path.is_dir() else path
    try:
        config = zenoh.Config.from_file(str(path))
        for name in ("connect", "listen"):
            endpoints = environment.get(f"PEOPLE4D_{name.upper()}")
            # Where the variables are set for all processes of a host, a router must not connect to
            # itself and a client must not take the router's port.
            if endpoints and (name, default) not in IGNORED:
                config.insert_json5(f"{name}/endpoints", json.dumps(endpoints.split(",")))
        keys = environment.get("PEOPLE4D_KEYS")
        if keys:
            role = role or environment.get("PEOPLE4D_ROLE", "")
            _insert_credentials(config, Path(keys), default, role)
    except zenoh.ZError as error:
        reason = problem_of(error)
        raise ConfigError(f"Zenoh configuration {path} is not usable: {reason}") from error
    return config


def _insert_credentials(config: zenoh.Config, folder: Path, mode: str, role: str) -> None:
    for path, value in credentials.settings(folder, mode, role).items():
        config.insert_json5(path, json.dumps(value))
    if not credentials.uses_certificates(folder):
        return
    for path in ("connect/endpoints", "listen/endpoints"):
        endpoints = config.get_json(path).replace('"tcp/', '"tls/')
        for protocol in re.findall(r'"([\w-]+)/', endpoints):
            if protocol not in ENCRYPTED:
                raise ConfigError(
                    f"{path}: {protocol} is not encrypted, but PEOPLE4D_KEYS holds certificates",
                    "Use tcp/ (which becomes tls/), tls/ or quic/.",
                )
        config.insert_json5(path, endpoints)


def problem_of(error: zenoh.ZError) -> str:
    """Return what an error of Zenoh says, without its source files."""
    text = " ".join(BUILD_PATH.sub("", str(error)).split())
    inner = re.search(r'Message { msg: "(.*)", location', text)
    return inner[1] if inner else text


def _open(config: zenoh.Config) -> zenoh.Session:
    endpoints = config.get_json("connect/endpoints")
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        if "listener" in str(error):
            raise People4dError(
                f"Zenoh cannot listen ({problem_of(error)})",
                "Does another router run on this host (people4d ps)? Else take another port "
                "(people4d up --port, or PEOPLE4D_LISTEN).",
            ) from error
        raise People4dError(
            f"no Zenoh session with {endpoints} ({problem_of(error)})",
            "Is the system up (people4d ps), the endpoint right (--connect), and do user, "
            "password or certificates match the router's?",
        ) from error


class KeyLimit:
    """Bound on the keys of a subscription, against invented names.

    Those that are heard of stay; a new one takes the slot of one that was silent for long.

    Args:
        keys_max: Number of keys.
    """

    def __init__(self, keys_max: int) -> None:
        self.keys_max = keys_max
        self._heard_s: dict[str, float] = {}  # monotonic, the one heard of last is the last
        self._full_until_s = -math.inf

    def admits(self, key: str, now_s: float) -> bool:
        """Note a message; return False if there are too many other keys."""
        if self._heard_s.pop(key, None) is None:
            if now_s < self._full_until_s:
                return False
            if len(self._heard_s) >= self.keys_max:
                oldest = next(iter(self._heard_s))
                self._full_until_s = self._heard_s[oldest] + KEY_FORGOTTEN_S
                if now_s < self._full_until_s:
                    return False
                del self._heard_s[oldest]
        self._heard_s[key] = now_s
        return True


class ZenohSubscription:
    """Payloads of one topic; iterate in a thread of its own.

    Args:
        subscriber: Of Zenoh.
        max_bytes: Longest payload that is read.
        keys_max: Keys of which payloads are read.
        but: Identifier of a session whose payloads are passed over; None: of none.
    """

    def __init__(
        self,
        subscriber: Any,
        max_bytes: int = IMAGE_MAX_BYTES,
        keys_max: int = KEYS_MAX,
        but: str | None = None,
    ) -> None:
        self._subscriber = subscriber
        self._max_bytes = max_bytes
        self._keys = KeyLimit(keys_max)
        self._but = but
        self._closed = False
        self._receiving = threading.Lock()
        self._refused, self._reported_s = 0, -math.inf  # messages that are not yet reported

    def __iter__(self) -> Iterator[tuple[str, bytes]]:
        """Yield key and payload until closed, `RefusedPayload` for what is not to be read.

        Messages on too many keys are reported a few times a second, with their number: a flood of
        them is to cost little.
        """
        while (sample := self._receive()) is not None:
            if sample.kind != zenoh.SampleKind.PUT or self._is_passed_over(sample):
                continue
            key, now_s = str(sample.key_expr), time.monotonic()
            is_admitted = self._keys.admits(key, now_s)
            self._refused += not is_admitted
            if self._refused and (is_admitted or now_s - self._reported_s > REPORT_S):
                text = f"expected at most {self._keys.keys_max} publishers at once, got more"
                yield key, RefusedPayload(text, self._refused)
                self._refused, self._reported_s = 0, now_s
            if is_admitted:
                size = len(sample.payload)
                if size <= self._max_bytes:
                    payload = sample.payload.to_bytes()
                else:
                    payload = RefusedPayload(
                        f"expected at most {self._max_bytes} bytes, got {size}"
                    )
                del sample  # it would take memory until the next one comes
                if size > self._max_bytes:
                    _release_memory()
                yield key, payload
                del payload

    def samples(self) -> Iterator[Any]:
        """Yield all samples, as Zenoh gives them, until closed."""
        while (sample := self._receive()) is not None:
            yield sample
            del sample  # it would take memory until the next one comes

    def _is_passed_over(self, sample: Any) -> bool:
        # The cache of this session replies to its own subscribers, too.
        source = sample.source_info if self._but else None
        return source is not None and str(source.source_id.zid) == self._but

    def _receive(self) -> Any:
        """Wait for a sample; None once closed."""
        try:
            with self._receiving:
                return None if self._closed else self._subscriber.handler.recv()
        except zenoh.ZError:
            return None

    @property
    def closed(self) -> bool:
        """True once the iteration was ended."""
        return self._closed

    def close(self) -> None:
        """End the iteration."""
        if not self._closed:
            self._closed = True
            self._subscriber.undeclare()
            # Python aborts if it ends while a thread is still inside of Zenoh.
            if self._receiving.acquire(timeout=CLOSE_S):
                self._receiving.release()


class ZenohSession:
    """Subscribes to the topics of one robot.

    Args:
        config: Zenoh configuration.
        robot: Name of the robot, third chunk of every key.
        connect_timeout_s: Longest wait for a router in client mode.

    Raises:
        ConfigError: The name of the robot cannot be part of a key.
        People4dError: No session: nothing listens at the endpoint, or it refuses the credentials.
    """

    def __init__(self, config: zenoh.Config, robot: str, connect_timeout_s: float = 0.0) -> None:
        check_chunk("robot", robot)
        self.robot = robot
        self._subscriptions: list[ZenohSubscription] = []
        self._threads: list[threading.Thread] = []
        # A command reports errors itself; raw lines of Zenoh belong into the logs of services.
        is_client = "client" in config.get_json("mode")
        zenoh.init_log_from_env_or("off" if is_client else "error")
        if connect_timeout_s:
            config.insert_json5("connect/timeout_ms", str(int(connect_timeout_s * 1000)))
            config.insert_json5("connect/exit_on_failure", "true")
        self._session = _open(config)

    def subscribe(self, topic: Topic, own: bool = True) -> ZenohSubscription:
        """Receive a topic; of a latched one the last message of each key comes first.

        Args:
            topic: The topic.
            own: Receive also what this session publishes.
        """
        key = topic.key_expression(self.robot)
        channel: Any = zenoh.handlers.RingChannel(
            LOCKSTEP_MAX if topic.delivery == "newest" else topic.depth
        )
        origin = zenoh.Locality.ANY if own else zenoh.Locality.REMOTE
        subscriber: Any
        if topic.delivery == "latched":
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
            subscriber = zenoh.ext.declare_advanced_subscriber(
                self._session, key, channel, allowed_origin=origin, history=history
            )
        else:
            subscriber = self._session.declare_subscriber(key, channel, allowed_origin=origin)
        self_id = None if own else str(self._session.info.zid())
        return self._keep(subscriber, topic.max_bytes, topic.keys_max, self_id)

    def present(self) -> list[tuple[str, str, str]]:
        """Return robot, service and instance of every live process, of all robots."""
        channel: Any = zenoh.handlers.FifoChannel(256)
        key = f"{prefix('*')}/alive/*/*"
        replies = self._session.liveliness().get(key, channel, timeout=ANSWER_S)
        keys = sorted({str(reply.ok.key_expr) for reply in replies if reply.ok})
        parts = (key.split("/") for key in keys)
        return [(robot, service, instance) for *_, robot, _, service, instance in parts]

    def query(self, name: str, on_reply: Callable[[bytes], None]) -> None:
        """Send a query; `on_reply` gets the reply in another thread, or is never called.

        It is not sent while one of the same name is under way.
        """
        channel: Any = zenoh.handlers.FifoChannel(1)

        def ask() -> None:  # a congested link holds up a query, so the caller does not send it
            try:
                replies = self._session.get(query_key(self.robot, name), channel, timeout=ANSWER_S)
            except zenoh.ZError:  # the session was closed
                return
            for reply in replies:
                if reply.ok:
                    on_reply(reply.ok.payload.to_bytes())

        thread_name = f"query {name}"
        if all(thread.name != thread_name for thread in self._threads if thread.is_alive()):
            self._start(ask, thread_name)

    def close(self) -> None:
        """End all subscriptions and leave the network."""
        for subscription in self._subscriptions:
            subscription.close()
        self._session.close()  # type: ignore[no-untyped-call]
        # Python aborts if it ends while a thread is still inside of Zenoh.
        for thread in self._threads:
            thread.join(CLOSE_S)

    def _keep(
        self,
        subscriber: Any,
        max_bytes: int = IMAGE_MAX_BYTES,
        keys_max: int = KEYS_MAX,
        but: str | None = None,
    ) -> ZenohSubscription:
        self._subscriptions = [one for one in self._subscriptions if not one.closed]
        self._subscriptions.append(ZenohSubscription(subscriber, max_bytes, keys_max, but))
        return self._subscriptions[-1]

    def _start(self, work: Callable[[], None], name: str) -> None:
        """Run what waits for Zenoh in a thread of its own, which has ended when `close` returns."""
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        self._threads.append(threading.Thread(target=work, name=name, daemon=True))
        self._threads[-1].start()


def _release_memory() -> None:
    """Return freed memory to the system, where the C library can.

    Zenoh receives a long payload in pieces, which otherwise stay in the arenas of its threads.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def check_chunk(field: str, name: str) -> None:
    """Check that a name can be one chunk of a key.

    Raises:
        ConfigError: It cannot.
    """
    try:
        check_name(field, name)
    except ValueError as error:
        raise ConfigError(str(error)) from error
