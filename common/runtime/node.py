"""Base class of the node of every service: messages in, messages out, without own I/O."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import msgspec

from people4d.messages import Message
from people4d.topics import ForeignTopic, Topic


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """State of a node for its heartbeat."""

    state: Literal["starting", "ready", "degraded", "finished"] = "ready"
    reason: str = ""  # reason of a state other than ready, one sentence
    # Number of events, and of drops by cause
    counters: dict[str, int] = msgspec.field(default_factory=dict)
    # current values by name; the suffix is the unit
    gauges: dict[str, float] = msgspec.field(default_factory=dict)


@dataclass(frozen=True)
class Sharing:
    """Work that the replicas of a service share."""

    work: type[Message]  # type of the messages that are divided between the replicas
    answer: type[Message]  # type of the answers, with the same camera and sequence


@dataclass(frozen=True)
class LoopCallbacks:
    """Callbacks of the run loop for its node."""

    # makes `tick` due at once; may be called from any thread
    wake: Callable[[], None] = lambda: None
    # admits another worker to the next message before `handle` returns
    release: Callable[[], None] = lambda: None
    # publishes one output before the result of `handle`; None: only the result is published
    publish: Callable[[Message], None] | None = None
    # returns the name of this process and the names of all replicas
    replicas: Callable[[], tuple[str, tuple[str, ...]]] = lambda: ("", ())
    # replaces the subscriptions of inputs on demand
    demand: Callable[[Collection[type[Message]]], None] = lambda _: None
    robot: str = ""  # name of the robot
    # folder of the robot's state; None: no file outlives the process
    state_folder: Path | None = None


NO_LOOP = LoopCallbacks()


class Node(ABC):
    """Base of nodes: messages in, messages out; without bus, files or clock.

    A node raises nothing for bad data: it counts the drop and reports it in its status. `now_ns` is
    a monotonic clock, for waiting only; stamps are from messages. Subclasses add no public methods,
    so a test detects a misspelt hook.

    Attributes:
        inputs: Types of messages that `handle` gets.
        required_inputs: Inputs that the node requires; the heartbeat reports their absence.
        periodic_outputs: Types that the node publishes without inputs; the heartbeat reports their
            absence.
        sharing: Work that replicas share; None if the node cannot have replicas.
        inputs_on_demand: Types that `handle` gets after a request by `LoopCallbacks.demand`.
        foreign_inputs: Topics of other programs that `handle` gets, too.
        frames_waiting: Length of the queue of a "newest" topic.
        workers: Number of threads that call `handle`; more than one requires a thread-safe node.
            Outputs are in the order of the inputs.
    """

    inputs: tuple[type[Message], ...] = ()
    required_inputs: ClassVar[tuple[type[Message], ...]] = ()
    periodic_outputs: ClassVar[tuple[type[Message], ...]] = ()
    sharing: ClassVar[Sharing | None] = None
    inputs_on_demand: ClassVar[tuple[type[Message], ...]] = ()
    foreign_inputs: Sequence[ForeignTopic] = ()
    frames_waiting: int = 1
    workers: int = 1

    def attach(self, loop: LoopCallbacks) -> None:  # noqa: B027
        """Set the callbacks of the loop that runs this node; called once, first."""

    def admits(self, topic: Topic, payload: bytes) -> bool:  # noqa: ARG002
        """Check before decoding that a message is useful; called by receiving threads.

        A message that is not admitted is not counted, nor is the gap in its sequence.
        """
        return True

    @abstractmethod
    def handle(self, message: Message, now_ns: int) -> Sequence[Message]:
        """Handle one message and return the resulting messages.

        Args:
            message: One of the types in `inputs` or of the topics in `foreign_inputs`.
            now_ns: Monotonic time in nanoseconds.
        """

    def tick(self, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Return the messages that are due; called after each message and at `wake_ns`."""
        return ()

    def flush(self, now_ns: int) -> Sequence[Message]:  # noqa: ARG002
        """Return outputs that wait for more input; called at the end of the input."""
        return ()

    def wake_ns(self) -> int | None:
        """Return the monotonic time of the next `tick` [ns]; None if none is required."""
        return None

    def is_finished(self) -> bool:
        """Check that the process may end as finished; called after each message."""
        return False

    def status(self) -> Status:
        """Return state, reason and counters for the heartbeat."""
        return Status()

    def close(self) -> None:  # noqa: B027
        """Release devices and files; called once, when the process ends."""


class StatefulNode(Node):
    """Node whose state outlives its process."""

    @abstractmethod
    def next_number(self) -> int:
        """Return the next unused number, for example of a person."""

    @abstractmethod
    def save(self) -> bytes:
        """Return the state; empty if there is none yet."""

    @abstractmethod
    def restore(self, saved: bytes, next_number: int) -> None:
        """Continue from the saved state of another process.

        DecodeError if `saved` is damaged; only the number is restored.

        Args:
            saved: Result of `save`; empty if it is lost.
            next_number: All numbers below it are used.
        """
