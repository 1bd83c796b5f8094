"""The run loop: messages from the bus to the node and back."""

import logging
import threading
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from common.runtime.checkpoint import Checkpoint, CheckpointStore
from common.runtime.heartbeat import Activity, Heartbeat
from common.runtime.inbox import Inbox, Turnstile
from common.runtime.node import LoopCallbacks, Node, StatefulNode
from common.runtime.replicas import Replica
from common.transport.trace import ProcessId, Tracer, span
from common.transport.zenoh_bus import ZenohBus
from people4d.messages import Message, Span
from people4d.queue import Arrival
from people4d.topics import BY_MESSAGE, Topic

LONGEST_WAIT_S = 0.25
READERS_S = 2.0

log = logging.getLogger("people4d")


@dataclass(frozen=True)
class LoopSettings:
    """Settings of a run loop."""

    workers: int = 1  # number of threads that call `handle`; outputs keep the order of the inputs
    traced: bool = True  # messages are marked with the times of their stages
    # folder of the checkpoints of a stateful node; None: none are saved
    state_folder: Path | None = None


DEFAULT = LoopSettings()


class Loop:
    """Runs a node on a bus until it is finished or stopped."""

    def __init__(
        self, node: Node, bus: ZenohBus, process_id: ProcessId, settings: LoopSettings = DEFAULT
    ) -> None:
        self._activity = Activity()
        self._replica = (
            Replica(bus, process_id, node.sharing, self._activity) if node.sharing else None
        )
        admits = None if type(node).admits is Node.admits else node.admits
        assignment = self._replica.assignment if self._replica else None
        self.inbox = Inbox(assignment, node.frames_waiting, admits)
        self._node = node
        self._bus = bus
        self._process_id = process_id
        self._workers = settings.workers
        self._tracer = Tracer(process_id, settings.traced)
        self._checkpoint = self._restored(settings.state_folder)
        self._stopped = False  # no Event: a signal may arrive while its lock is held
        self._turnstile = Turnstile()
        self._working = threading.local()  # ticket and spans of the message handled by this thread
        self._turn = threading.Condition()
        self._published = 0
        self._readers: list[threading.Thread] = []
        self._state_folder = settings.state_folder
        self._demanded: dict[type[Message], ExitStack] = {}
        self._demanding = threading.Lock()
        self.ready = threading.Event()  # set after all subscriptions

    def run(self) -> None:
        """Handle messages until `stop` or the end of the node, then the waiting messages."""
        self._node.attach(
            LoopCallbacks(
                wake=self.inbox.wake,
                release=self._turnstile.release,
                # With receivers in this process early publication only adds contention for the
                # interpreter.
                publish=None if self._bus.exchange else self._send,
                replicas=self._replica.names if self._replica else lambda: ("", ()),
                demand=self._demand,
                robot=self._bus.robot,
                state_folder=self._state_folder,
            )
        )
        own = (BY_MESSAGE[kind] for kind in self._node.inputs)
        topics = [*own, *self._node.foreign_inputs]
        subscriptions = [self._subscribe(topic) for topic in topics]
        helpers = [threading.Thread(target=self._serve) for _ in range(self._workers - 1)]
        for helper in helpers:
            helper.start()
        self._join()
        heartbeat = Heartbeat(self._node, self._bus, self._process_id, self.inbox, self._activity)
        self.ready.set()
        try:
            self._serve_and_tick()
        finally:
            self.stop()
            self._leave()
            self._demand(())
            for subscription in subscriptions:
                subscription.close()
            for reader in self._readers:  # messages of readers are already counted as received
                reader.join(READERS_S)
            self._drain()
            for helper in helpers:
                helper.join()
            self._publish(*self._call(self._flush))
            try:
                if self._checkpoint:
                    self._checkpoint.save_state()
                self._node.close()
            finally:
                heartbeat.close()

    def stop(self) -> None:
        """End `run`; may be called from a signal handler or another thread."""
        self._stopped = True
        self.inbox.wake()

    def _restored(self, folder: Path | None) -> Checkpoint | None:
        if not folder or not isinstance(self._node, StatefulNode):
            return None
        store = CheckpointStore(folder, self._process_id.instance)
        return Checkpoint(self._node, store, self._activity)

    def _join(self) -> None:
        if self._replica:
            self._replica.join(self.inbox)
        else:
            self._bus.announce(self._process_id.service, self._process_id.instance)

    def _leave(self) -> None:
        """Hand the work to other replicas before the subscriptions end, so no message is lost."""
        if self._replica:
            self._replica.leave()
        else:
            self._bus.withdraw(self._process_id.service)

    def _subscribe(self, topic: Topic) -> ExitStack:
        """Subscribe to a topic until the result is closed."""
        ends, subscription = ExitStack(), self._bus.subscribe(topic)
        ends.callback(subscription.close)
        self._readers = [reader for reader in self._readers if reader.is_alive()]
        self._readers.append(self.inbox.follow(subscription, topic))
        if self._bus.exchange:
            ends.enter_context(self._bus.exchange.subscribe(topic, self.inbox.add_message))
        return ends

    def _demand(self, kinds: Collection[type[Message]]) -> None:
        """Subscribe to requested inputs on demand, and end other subscriptions."""
        with self._demanding:
            for kind in set(self._demanded).difference(kinds):
                self._demanded.pop(kind).close()
            for kind in kinds:
                if kind not in self._demanded and not self._stopped:
                    self._demanded[kind] = self._subscribe(BY_MESSAGE[kind])

    def _take(self, timeout_s: float) -> Arrival | None:
        """Take a message; a replaceable frame only when the network is free for it."""
        if not self._turnstile.acquire(timeout_s):
            return None
        arrival = self.inbox.get(timeout_s)
        if arrival is None or not _may_be_replaced(arrival.message):
            self._turnstile.release()
        return arrival

    def _serve(self) -> None:
        while not self._stopped:
            arrival = self._take(LONGEST_WAIT_S)
            if arrival:
                self._handle(arrival)

    def _serve_and_tick(self) -> None:
        while not self._stopped:
            arrival = self._take(self._wait_s())
            if arrival:
                self._handle(arrival)
            outputs, spans = self._call(self._tick)
            self._publish(outputs, spans)
            if self._node.is_finished():
                reason = self._node.status().reason
                log.info("finished%s", f": {reason}" if reason else "")
                return

    def _drain(self) -> None:
        while arrival := self.inbox.get(0.0):
            self._handle(arrival)

    def _wait_s(self) -> float:
        wake_ns = self._node.wake_ns()
        if wake_ns is None:
            return LONGEST_WAIT_S
        return min(max((wake_ns - time.monotonic_ns()) / 1e9, 0.0), LONGEST_WAIT_S)

    def _handle(self, arrival: Arrival) -> None:
        taken_ns = time.time_ns()
        self._activity.note_taken(_name(arrival.message), arrival.received_ns)
        message = self._tracer.taken(
            arrival.message, arrival.received_ns, arrival.decoded_ns, taken_ns
        )
        self._working.ticket = arrival.ticket
        outputs, spans = self._call(lambda: self._answer(message))
        self._turnstile.release()
        spans = self._tracer.handled(taken_ns, spans)
        if self._replica:
            self._replica.note_duration((time.time_ns() - taken_ns) / 1e9)
        self._wait_turn(arrival.ticket)
        try:
            self._publish(outputs, spans)
        finally:
            with self._turn:
                self._published += 1
                self._turn.notify_all()

    def _answer(self, message: Message) -> Sequence[Message]:
        outputs = self._node.handle(message, time.monotonic_ns())
        if self._checkpoint:
            self._checkpoint.handled()
        return outputs

    def _tick(self) -> Sequence[Message]:
        now_ns = time.monotonic_ns()
        outputs = self._node.tick(now_ns)
        if self._checkpoint:
            self._checkpoint.ticked(now_ns, bool(outputs))
        return outputs

    def _flush(self) -> Sequence[Message]:
        outputs = self._node.flush(time.monotonic_ns())
        if self._checkpoint:
            self._checkpoint.save_number()
        return outputs

    def _send(self, message: Message) -> None:
        """Publish one output of a node before the rest of its answer."""
        with span("publish"):
            self._wait_turn(self._working.ticket)
            self._publish([message], self._working.spans)

    def _wait_turn(self, ticket: int) -> None:
        with self._turn:
            self._turn.wait_for(lambda: self._published == ticket)

    def _call(self, work: Callable[[], Sequence[Message]]) -> tuple[Sequence[Message], list[Span]]:
        with self._activity.busy(), self._tracer.working() as spans:
            self._working.spans = spans
            try:
                return work(), spans
            except Exception as error:  # a bug in a node must not end the stream
                self._activity.note_error(error, "the node failed")
                return (), spans

    def _publish(self, outputs: Iterable[Message], spans: list[Span]) -> None:
        messages = [self._tracer.worked(message, spans) for message in outputs]
        if self._bus.exchange:
            messages = [each for each in messages if self._attempt(self._bus.hand_over, each)]
            time.sleep(0)  # services of this process start before messages are encoded for others
        for message in messages:
            if self._attempt(self._bus.send, message):
                self._activity.count(f"sent_{BY_MESSAGE[type(message)].name}")

    def _attempt(
        self, publish: Callable[[Message, Callable[[], Span] | None], None], message: Message
    ) -> bool:
        """Publish a message by a function; return False, recorded, if it fails."""
        try:
            publish(message, self._tracer.publishing(message))
        except Exception as error:  # one bad message must not end the thread that sends
            self._activity.note_error(error, f"{type(message).__name__} could not be sent")
            return False
        return True


def _name(message: Message) -> str:
    """Return the name of a message's topic, or its type if it is from a foreign topic."""
    topic = BY_MESSAGE.get(type(message))
    return topic.name if topic else type(message).__name__


def _may_be_replaced(message: Message) -> bool:
    topic = BY_MESSAGE.get(type(message))
    return topic is not None and topic.may_be_replaced(message)
