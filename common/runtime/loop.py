"""The run loop: messages from the bus to the node and back."""

import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.runtime.checkpoint import Checkpoint, Keeper
from common.runtime.gate import Gate
from common.runtime.heartbeat import Heartbeat, Work
from common.runtime.inbox import Inbox
from common.runtime.node import LoopCallbacks, Node, StatefulNode
from common.runtime.process_id import Place
from common.runtime.replica import Replica
from common.transport.bus import Bus, Subscription
from common.transport.trace import Tracer, span
from people4d.messages import Message, RgbdFrame, Span
from people4d.queue import Arrival
from people4d.topics import BY_MESSAGE, Topic

LONGEST_WAIT_S = 0.25
READERS_S = 2.0

log = logging.getLogger("people4d")


@dataclass(frozen=True)
class LoopSettings:
    """Settings of a run loop.

    Args:
        workers: Threads that call `handle` at once; outputs keep the order of the inputs.
        traced: Messages are marked with the times of their stages.
        state_folder: Where the state of a stateful node is saved; None: nowhere.
    """

    workers: int = 1
    traced: bool = True
    state_folder: Path | None = None


ALONE = LoopSettings()


class Loop:
    """Runs a node on a bus until it is finished or told to stop.

    Args:
        node: What to run.
        bus: Where messages come from and go to.
        place: Which process this is.
        settings: How it is run.
    """

    def __init__(self, node: Node, bus: Bus, place: Place, settings: LoopSettings = ALONE) -> None:
        self._work = Work()
        self._replica = Replica(bus, place, node.sharing, self._work) if node.sharing else None
        self.inbox = Inbox(self._replica.share if self._replica else None, node.frames_waiting)
        self._node = node
        self._bus = bus
        self._place = place
        self._workers = settings.workers
        self._tracer = Tracer(place, settings.traced)
        self._checkpoint = self._restored(settings.state_folder)
        self._stopped = False  # no Event: a signal may come while its lock is held
        self._gate = Gate()
        self._working = threading.local()  # ticket and spans of what this thread handles
        self._turn = threading.Condition()
        self._published = 0
        self._readers: list[threading.Thread] = []

    def run(self) -> None:
        """Handle messages until `stop` is called or the node is finished, then what still waits."""
        self._node.attach(
            LoopCallbacks(
                wake=self.inbox.wake,
                release=self._gate.open,
                publish=self._send,
                replicas=self._replica.all if self._replica else lambda: ("", ()),
            )
        )
        own = (BY_MESSAGE[kind] for kind in self._node.inputs)
        topics = [*own, *self._node.foreign_inputs]
        subscriptions = [self._subscribe(topic) for topic in topics]
        helpers = [threading.Thread(target=self._serve) for _ in range(self._workers - 1)]
        for helper in helpers:
            helper.start()
        self._join()
        heartbeat = Heartbeat(self._node, self._bus, self._place, self.inbox, self._work)
        try:
            self._serve_and_tick()
        finally:
            self.stop()
            self._leave()
            for subscription in subscriptions:
                subscription.close()
            for reader in self._readers:  # what they took already counts as received
                reader.join(READERS_S)
            self._drain()
            for helper in helpers:
                helper.join()
            self._publish(*self._ask(self._flush))
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
        return Checkpoint(self._node, Keeper(folder, self._place.instance), self._work)

    def _join(self) -> None:
        if self._replica:
            self._replica.join(self.inbox)
        else:
            self._bus.announce(self._place.service, self._place.instance)

    def _leave(self) -> None:
        """Give what is shared to the others before the subscriptions end: nothing is left so."""
        if self._replica:
            self._replica.leave()
        else:
            self._bus.withdraw()

    def _subscribe(self, topic: Topic) -> Subscription:
        subscription = self._bus.subscribe(topic)
        self._readers.append(self.inbox.follow(subscription, topic))
        return subscription

    def _take(self, timeout_s: float) -> Arrival | None:
        """Take a message; one that a newer may replace only when the network is free for it."""
        if not self._gate.enter(timeout_s):
            return None
        arrival = self.inbox.get(timeout_s)
        if arrival is None or not _may_be_replaced(arrival.message):
            self._gate.open()
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
            outputs, spans = self._ask(self._tick)
            self._publish(outputs, spans)
            status = self._node.status()
            if status.state == "finished":
                log.info("finished%s", f": {status.reason}" if status.reason else "")
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
        self._work.took(_name(arrival.message), arrival.received_ns)
        message = self._tracer.taken(
            arrival.message, arrival.received_ns, arrival.decoded_ns, taken_ns
        )
        self._working.ticket = arrival.ticket
        outputs, spans = self._ask(lambda: self._answer(message))
        self._gate.open()
        spans = self._tracer.handled(taken_ns, spans)
        if self._replica:
            self._replica.worked((time.time_ns() - taken_ns) / 1e9)
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
        """Publish what a node has ready before the rest of its answer."""
        with span("publish"):
            self._wait_turn(self._working.ticket)
            self._publish([message], self._working.spans)

    def _wait_turn(self, ticket: int) -> None:
        with self._turn:
            self._turn.wait_for(lambda: self._published == ticket)

    def _ask(
        self, question: Callable[[], Sequence[Message]]
    ) -> tuple[Sequence[Message], list[Span]]:
        with self._work.busy(), self._tracer.working() as spans:
            self._working.spans = spans
            try:
                return question(), spans
            except Exception:  # a bug in a node must not end the stream
                self._work.count("errors")
                log.exception("the node failed")
                return (), spans

    def _publish(self, outputs: Iterable[Message], spans: list[Span]) -> None:
        for message in outputs:
            traced = self._tracer.worked(message, spans)
            try:
                self._bus.publish(traced, self._tracer.publishing(traced))
                self._work.count(f"sent_{BY_MESSAGE[type(message)].name}")
            except Exception:  # what cannot be sent must not end the thread that sends
                self._work.count("errors")
                log.exception("%s could not be sent", type(message).__name__)


def _name(message: Message) -> str:
    """Return the name of a message's topic; what others define may be no message of ours."""
    topic = BY_MESSAGE.get(type(message))
    return topic.name if topic else type(message).__name__


def _may_be_replaced(message: Message) -> bool:
    topic = BY_MESSAGE.get(type(message))
    newest = topic is not None and topic.delivery == "newest"
    return newest and not (isinstance(message, RgbdFrame) and message.lockstep)
