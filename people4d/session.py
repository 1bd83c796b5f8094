"""Zenoh sessions of a robot's network: configuration, credentials and subscriptions."""

import json
import os
import re
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import zenoh
import zenoh.ext

from people4d import credentials
from people4d.errors import ConfigError, People4dError
from people4d.messages.base import check_name
from people4d.ownership import Announcements, KeyOwners
from people4d.subscription import CLOSE_S, ZenohSubscription
from people4d.topics import IMAGE_MAX_BYTES, KEYS_MAX, LOCKSTEP_MAX, Topic, prefix, query_key

BUILD_PATH = re.compile(r"( at)? ?[^ ]*\.rs:\d+(:\d+)?\.?")  # path of a source file of Zenoh
NO_ANSWER = re.compile(r"Unable to connect to any of .*Timeout!")
SILENT = "it does not answer"

CONFIGS = Path(__file__).parent / "zenoh"
ANSWER_S = 2.0
ENCRYPTED = ("tls", "quic")
IGNORED = {("connect", "router"), ("listen", "client")}
HOST_AND_PORT = re.compile(r"(\[[^\]]+\]|[^/\[\]:]+):\d+")  # an endpoint without its protocol


def read_config(
    file: Path | None, default: str, environment: Mapping[str, str] | None = None, role: str = ""
) -> zenoh.Config:
    """Read a Zenoh configuration (Zenoh's own JSON5) and insert endpoints and credentials.

    Args:
        file: The file, or a folder of one for each mode; None for $PEOPLE4D_ZENOH, else the
            shipped ones.
        default: Mode, which names the file in a folder: "peer", "router", "client" or "area".
        environment: PEOPLE4D_CONNECT and PEOPLE4D_LISTEN (endpoints, comma-separated) override the
            file; other variables are in docs/launch/hosts.md; None for the environment of the
            process.
        role: Role to prove; empty: $PEOPLE4D_ROLE, required if the folder of keys has several.

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
            # With the same variables for all processes of a host, a router must not connect to
            # itself and a client must not listen on the port of the router.
            if endpoints and (name, default) not in IGNORED:
                config.insert_json5(f"{name}/endpoints", json.dumps(endpoints_of(endpoints)))
        keys = environment.get("PEOPLE4D_KEYS")
        if keys:
            role = role or environment.get("PEOPLE4D_ROLE", "")
            _insert_credentials(config, Path(keys), default, role)
    except zenoh.ZError as error:
        reason = problem_of(error)
        raise ConfigError(f"Zenoh configuration {path} is not usable: {reason}") from error
    return config


def endpoints_of(text: str) -> list[str]:
    """Return the endpoints of a comma-separated text; HOST:PORT becomes tcp/HOST:PORT.

    Raises:
        ConfigError: A part is not an endpoint.
    """
    endpoints = [part.strip() for part in text.split(",") if part.strip()]
    full = [f"tcp/{one}" if HOST_AND_PORT.fullmatch(one) else one for one in endpoints]
    for endpoint in full:
        protocol, _, address = endpoint.partition("/")
        if not (protocol and address):
            raise ConfigError(
                f"{endpoint!r} is not an endpoint", "Write it as tcp/192.168.1.7:7447."
            )
    return full


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
    """Return the text of a Zenoh error without paths of source files."""
    text = " ".join(BUILD_PATH.sub("", str(error)).split())
    text = NO_ANSWER.sub(SILENT, text)
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
            ) from None
        raise People4dError(
            f"no Zenoh session with {endpoints} ({problem_of(error)})",
            "Is the system up (people4d ps), the endpoint right (--connect), and do user, "
            "password or certificates match the router's?",
        ) from None


class ZenohSession:
    """Subscribes to the topics of one robot.

    Args:
        config: Zenoh configuration.
        robot: Name of the robot, third chunk of every key.
        connect_timeout_s: Maximum wait for a router in client mode [s].

    Raises:
        ConfigError: The name of the robot cannot be part of a key.
        People4dError: Nothing listens at the endpoint, or it refuses the credentials.
    """

    def __init__(self, config: zenoh.Config, robot: str, connect_timeout_s: float = 0.0) -> None:
        check_chunk("robot", robot)
        self.robot = robot
        self._subscriptions: list[ZenohSubscription] = []
        self._threads: list[threading.Thread] = []
        self._announcements, self._follows = Announcements(), False
        # Commands report errors themselves; log lines of Zenoh are for services.
        is_client = "client" in config.get_json("mode")
        zenoh.init_log_from_env_or("off" if is_client else "error")
        if connect_timeout_s:
            config.insert_json5("connect/timeout_ms", str(int(connect_timeout_s * 1000)))
            config.insert_json5("connect/exit_on_failure", "true")
        self._session = _open(config)

    def subscribe(self, topic: Topic, own: bool = True) -> ZenohSubscription:
        """Receive a topic; a latched topic begins with the last message of each key.

        Args:
            topic: Topic to receive.
            own: Receive messages of this session, too.
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
        self_id = None if own else self.identity
        owners = KeyOwners(topic, self._follow_announcements()) if topic.owned else None
        return self._keep(subscriber, topic.max_bytes, topic.keys_max, self_id, owners)

    def send_bytes(self, key: str, payload: bytes) -> None:
        """Publish bytes under a full key."""
        self._session.put(key, payload)

    @property
    def identity(self) -> str:
        """Identity of the session, as Zenoh writes it."""
        return str(self._session.info.zid())

    def present(self) -> list[tuple[str, str, str]]:
        """Return robot, service and instance of every live process, of all robots."""
        channel: Any = zenoh.handlers.FifoChannel(256)
        key = f"{prefix('*')}/alive/*/*"
        try:
            replies = self._session.liveliness().get(key, channel, timeout=ANSWER_S)
        except zenoh.ZError:  # the session was closed
            return []
        keys = sorted({str(reply.ok.key_expr) for reply in replies if reply.ok})
        parts = (key.split("/") for key in keys)
        return [(robot, service, instance) for *_, robot, _, service, instance in parts]

    def query(self, name: str, on_reply: Callable[[bytes], None]) -> None:
        """Send a query; `on_reply` gets the reply in another thread, or is never called.

        A query is not sent while another one with its name is pending.
        """
        channel: Any = zenoh.handlers.FifoChannel(1)

        def ask() -> None:  # a congested link delays a query, so it has a thread of its own
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

    @property
    def closed(self) -> bool:
        """True once the session has left the network."""
        return bool(self._session.is_closed())

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
        exclude: str | None = None,
        owners: KeyOwners | None = None,
    ) -> ZenohSubscription:
        self._subscriptions = [one for one in self._subscriptions if not one.closed]
        self._subscriptions.append(
            ZenohSubscription(subscriber, max_bytes, keys_max, exclude, owners)
        )
        return self._subscriptions[-1]

    def _tokens_of(self, key: str) -> ZenohSubscription:
        """Receive liveliness tokens: the present ones, then changes."""
        # A FIFO, since a ring would lose tokens.
        channel: Any = zenoh.handlers.FifoChannel(256)
        return self._keep(self._session.liveliness().declare_subscriber(key, channel, history=True))

    def _follow_announcements(self) -> Announcements:
        """Return the announcements of processes, followed from the first call on."""
        if not self._follows:
            self._follows = True
            tokens = self._tokens_of(f"{prefix(self.robot)}/alive/*/*/*")

            def follow() -> None:
                for key, is_present in tokens.tokens():
                    self._announcements.update_token(key, is_present)

            self._start(follow, "announcements")
        return self._announcements

    def _start(self, work: Callable[[], None], name: str) -> None:
        """Run work that waits for Zenoh in a thread, which `close` joins."""
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        self._threads.append(threading.Thread(target=work, name=name, daemon=True))
        self._threads[-1].start()


def check_chunk(field: str, name: str) -> None:
    """Check that a name can be one chunk of a key.

    Raises:
        ConfigError: It cannot.
    """
    try:
        check_name(field, name)
    except ValueError as error:
        raise ConfigError(str(error)) from error
