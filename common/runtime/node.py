"""The shape of a service without its input and output."""

from collections.abc import Sequence
from typing import ClassVar, Literal, Protocol

import msgspec

from people4d.messages import Message


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """What a node says of itself in its heartbeat."""

    state: Literal["starting", "ready", "degraded", "finished"] = "ready"
    reason: str = ""  # why it is not ready, one sentence; finished: the process may end
    counters: dict[str, int] = msgspec.field(default_factory=dict)  # events, drops by cause


class Node(Protocol):
    """Messages in, messages out; no bus, no files, no clock of its own.

    It may name in `takes` the messages without which it can do nothing, and in `gives` those that
    it sends by itself; its heartbeat tells when none come.

    A node raises nothing for bad data: it counts the drop and says so in its status. `now_ns` is a
    monotonic clock, good for waiting only; stamps come from the messages.
    """

    inputs: ClassVar[tuple[type[Message], ...]]

    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Take one message and return what follows from it.

        Args:
            message: One of the types in `inputs`.
            now_ns: Monotonic time in nanoseconds.
        """
        ...

    def tick(self, now_ns: int) -> Sequence[Message]:
        """Return what is due by now; called after each message and at `wake_ns`."""
        ...

    def wake_ns(self) -> int | None:
        """Return the monotonic time in nanoseconds at which `tick` is wanted, None if at none."""
        ...

    def status(self) -> Status:
        """Return what the heartbeat shall say."""
        ...

    def close(self) -> None:
        """Release devices and files; called once, when the process ends."""
        ...
