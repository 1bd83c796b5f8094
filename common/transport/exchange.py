"""Messages between the services of one process, passed without encoding."""

import threading
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, TypeVar

import msgspec
import numpy as np

from people4d.messages import Message
from people4d.topics import Topic

M = TypeVar("M", bound=Message)
Taker = Callable[[Topic, str, Message], None]  # receiver of topic, full key and message


class Exchange:
    """Passes each message to all services of this process that subscribe to its topic.

    All services get the same object, with read-only arrays. A late subscriber of a latched topic
    gets the last message of each key first, as through Zenoh.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._takers: dict[str, tuple[Taker, ...]] = {}  # receivers by topic
        # Last message by topic and key
        self._last: dict[str, dict[str, tuple[Topic, Message]]] = {}

    def subscribe(self, topic: Topic, take: Taker) -> ExitStack:
        """Pass the messages of a topic to `take` until the result is closed."""
        with self._lock:
            self._takers[topic.name] = (*self._takers.get(topic.name, ()), take)
            latched = list(self._last.get(topic.name, {}).items())
        for key, (of, message) in latched:
            take(of, key, message)
        subscription = ExitStack()
        subscription.callback(self._unsubscribe, topic, take)
        return subscription

    def publish(self, topic: Topic, key: str, message: Message) -> None:
        """Pass a message to the queues of all subscribers."""
        if topic.delivery != "latched" and topic.name not in self._takers:
            return
        received = as_received(message)
        with self._lock:
            if topic.delivery == "latched":
                self._last.setdefault(topic.name, {})[key] = topic, received
            takers = self._takers.get(topic.name, ())
        for take in takers:
            take(topic, key, received)

    def _unsubscribe(self, topic: Topic, take: Taker) -> None:
        with self._lock:
            left = tuple(other for other in self._takers[topic.name] if other != take)
            self._takers[topic.name] = left
            if not left:
                del self._takers[topic.name]


def as_received(message: M) -> M:
    """Return a message as `decode(encode(message))` does, without copying its arrays.

    Numbers of numpy become Python's own, and arrays contiguous and read-only; fields are not
    checked.
    """
    return _plain(message)  # type: ignore[no-any-return]


def size_of(message: Message) -> int:
    """Return the size of the arrays and blobs of a message; the rest is small."""
    return sum(
        value.nbytes if isinstance(value, np.ndarray) else len(value)
        for value in msgspec.structs.asdict(message).values()
        if isinstance(value, (np.ndarray, bytes))
    )


def _plain(value: Any) -> Any:
    kind = type(value)
    if kind in (float, int, str, bool, type(None), bytes):
        return value
    if isinstance(value, msgspec.Struct):
        changed = {
            name: plain
            for name, field in msgspec.structs.asdict(value).items()
            # The trace is from the tracer, valid and long.
            if name != "trace" and (plain := _plain(field)) is not field
        }
        return msgspec.structs.replace(value, **changed) if changed else value
    if isinstance(value, np.ndarray):
        if not value.flags.writeable and value.flags.c_contiguous:
            return value
        view = np.ascontiguousarray(value).view()
        view.flags.writeable = False
        return view
    return _plain_other(value)


def _plain_other(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, (list, tuple)):
        items = [_plain(item) for item in value]
        same = isinstance(value, tuple) and all(a is b for a, b in zip(items, value, strict=True))
        return value if same else tuple(items)
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, (memoryview, bytearray)):
        return bytes(value)
    return value
