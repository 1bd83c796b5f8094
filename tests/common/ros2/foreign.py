"""Third-party clients of ROS 2 topics: zenoh-ros2-sdk, pamoja-ros2 and Zenoh itself."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh
from rosbags.interfaces import Nodetype
from zenoh_ros2_sdk import message_registry
from zenoh_ros2_sdk.session import ZenohSession

from common.ros2 import types
from tests.network import WAIT_S


def definition(kind: str) -> str:
    """Return the text of one type, without nested types."""
    lines = []
    fields: Any = types.typestore().fielddefs[kind][1]
    for name, (node, detail) in fields:
        if node in (Nodetype.NAME, Nodetype.BASE):
            text = _type_name(kind, node, detail)
        else:
            (inner, inner_detail), size = detail
            bound = str(size) if node is Nodetype.ARRAY else f"<={size}" if size else ""
            text = f"{_type_name(kind, inner, inner_detail)}[{bound}]"
        lines.append(f"{text} {name}\n")
    return "".join(lines)


def inside(kind: str) -> list[str]:
    """Return a type and all types inside it, the innermost first."""
    found: list[str] = []
    fields: Any = types.typestore().fielddefs[kind][1]
    for _, (node, detail) in fields:
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            node, detail = detail[0]
        if node is Nodetype.NAME:
            found += [name for name in inside(str(detail)) if name not in found]
    return [*found, kind]


def _type_name(kind: str, node: Nodetype, detail: Any) -> str:
    if node is not Nodetype.NAME:
        return str(detail[0])
    # Types in the authors' form; the SDK reads no array of a name with slashes.
    package, _, short = str(detail).split("/")
    return short if kind.startswith(f"{package}/") else f"{package}/{short}"


class Sdk:
    """zenoh-ros2-sdk on a router; types are read from files, so it downloads none."""

    def __init__(self, endpoint: str, folder: Path) -> None:
        self.where = {"router_ip": "127.0.0.1", "router_port": int(endpoint.rpartition(":")[2])}
        self.session = ZenohSession.get_instance(**self.where)
        self.registry = message_registry.get_registry(str(folder))
        self.registry.messages_dir = folder
        self._folder = folder

    def learn(self, kind: str) -> str:
        """Register a type and its nested types; return its own definition."""
        for name in inside(kind):
            package, _, short = name.split("/")
            file = self._folder / package / "msg" / f"{short}.msg"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(definition(name))
            self.session.register_message_type(definition(name), name)
        return definition(kind)

    def close(self) -> None:
        """Leave the network."""
        self.session.close()


@contextmanager
def raw_session(endpoint: str) -> Iterator[zenoh.Session]:
    """Open a plain Zenoh session."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        yield session


class Received:
    """Messages in the order of their arrival."""

    def __init__(self) -> None:
        self.messages: list[Any] = []
        self._changed = threading.Condition()

    def __call__(self, message: Any) -> None:
        with self._changed:
            self.messages.append(message)
            self._changed.notify_all()

    def wait(self, send: Callable[[], object] = lambda: None) -> Any:
        """Send repeatedly until a message arrives, and return the first."""
        end = time.monotonic() + WAIT_S
        with self._changed:
            while not self.messages:
                assert time.monotonic() < end, "no message came"
                send()
                self._changed.wait(0.05)
            return self.messages[0]


def until(condition: Callable[[], object], do: Callable[[], object] = lambda: None) -> None:
    """Wait for a condition, and repeat an action meanwhile."""
    end, waiting = time.monotonic() + WAIT_S, threading.Event()
    while not condition():
        assert time.monotonic() < end, "it never happened"
        do()
        waiting.wait(0.05)
