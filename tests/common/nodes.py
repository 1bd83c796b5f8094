"""Small real nodes for tests."""

import threading
from collections.abc import Callable, Sequence
from typing import Literal

from common.runtime.node import Node, Status
from common.transport.trace import span
from people4d.messages import Detections, Message, Tracks
from tests import builders


def detections(sequence: int, camera: str = "front") -> Detections:
    """Return an empty message with a number."""
    return builders.detections(
        stamp_ns=1000 + sequence, sequence=sequence, camera=camera, frame_id="optical"
    )


class Echo(Node):
    """Answers Detections with empty Tracks of the same stamp; a camera named "bad" raises."""

    inputs: tuple[type[Message], ...] = (Detections,)

    def __init__(self, hook: Callable[[Message], None] = lambda _: None) -> None:
        self.hook = hook
        self.handled: list[int] = []
        self.state: Literal["starting", "ready", "degraded", "finished"] = "ready"
        self.reason = ""
        self.due: list[Message] = []
        self.closed = False

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        self.handled.append(message.sequence)
        assert isinstance(message, Detections)
        with span("work"):
            self.hook(message)
        if message.camera == "bad":
            raise RuntimeError("a bug in the node")
        return [
            Tracks(
                stamp_ns=message.stamp_ns,
                sequence=message.sequence,
                trace=message.trace,
                frame_id="map",
                tracker="echo",
                camera=message.camera,
            )
        ]

    def tick(self, now_ns: int) -> Sequence[Message]:
        due, self.due = self.due, []
        return due

    def status(self) -> Status:
        counters = {"handled": len(self.handled), "skipped": 0}
        return Status(state=self.state, reason=self.reason, counters=counters)

    def close(self) -> None:
        self.closed = True


class Source(Node):
    """Sends a number of Truth messages, one at each tick, and finishes."""

    def __init__(self, count: int) -> None:
        self.left = count
        self.sent = 0
        self.closed = threading.Event()

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        raise AssertionError("a node without inputs got a message")

    def tick(self, now_ns: int) -> Sequence[Message]:
        if not self.left:
            return []
        self.left -= 1
        self.sent += 1
        return [builders.truth(stamp_ns=now_ns, sequence=self.sent - 1)]

    def wake_ns(self) -> int | None:
        return 0 if self.left else None

    def is_finished(self) -> bool:
        return not self.left

    def status(self) -> Status:
        return Status(state="ready" if self.left else "finished")

    def close(self) -> None:
        self.closed.set()
