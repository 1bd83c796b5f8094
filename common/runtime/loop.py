"""The run loop: messages from the bus to the node and back."""

import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence

from common.runtime.gate import Gate
from common.runtime.heartbeat import Heartbeat, Work
from common.runtime.inbox import Arrival, Inbox
from common.runtime.node import Node
from common.runtime.process_id import Place
from common.runtime.replica import Replica
from common.runtime.sharing import Sharing
from common.transport.bus import Bus, Subscription
from common.transport.trace import Tracer, span
from people4d.messages import Message, Span
from people4d.topics import BY_MESSAGE, ForeignTopic, Topic

LONGEST_WAIT_S = 0.25
READERS_S = 2.0

log = logging.getLogger("people4d")


class Loop:
    """Runs a node on a bus until it is finished or told to stop.

    Args:
        node: What to run. It is told what it has a method for: `set_wake`, a callback that makes
            `tick` due at once, for nodes that are fed by a thread of their own; `set_next`, what
            lets another thread take the next message before `handle` returns; `set_send`, what
            publishes one answer before the others. If it has `foreign_inputs`, these topics of
            others come to `handle`, too. If it has `newest`, so many frames wait while it is busy,
            else one. If it has `sharing`, it does that work by turns with its
            replicas, and `set_replicas` gets what tells their names.
        bus: Where messages come from and go to.
        place: Which process this is.
        workers: Threads that call `handle` at once; outputs keep the order of the inputs.
        traced: Whether messages are marked with the times of their stages.
    """

    def __init__(
        self, node: Node, bus: Bus, place: Place, workers: int = 1, traced: bool = True
    ) -> None:
        sharing: Sharing | None = getattr(node, "sharing", None)
        self._work = Work()
        self._replica = Replica(bus, place, sharing, self._work) if sharing else None
        share = self._replica.share if self._replica else None
        self.inbox = Inbox(share, getattr(node, "newest", 1))
        self._node = node
        self._bus = bus
        self._place = place
        self._workers = workers
        self._tracer = Tracer(place, traced)
        self._stopped = False  # no Event: a signal may come while its lock is held
        self._gate = Gate()
        self._working = threading.local()  # ticket and spans of what this thread handles
        self._turn = threading.Condition()
        self._published = 0
        self._readers: list[threading.Thread] = []

    def run(self) -> None:
        """Handle messages until `stop` is called or the node is finished, then what still waits."""
        self._tell_node("set_wake", self.inbox.wake)
        self._tell_node("set_next", self._gate.open)
        self._tell_node("set_send", self._send)
        if self._replica:
            self._tell_node("set_replicas", self._replica.all)
        foreign: Sequence[ForeignTopic] = getattr(self._node, "foreign_inputs", ())
        topics = [*(BY_MESSAGE[kind] for kind in self._node.inputs), *foreign]
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
            self._flush()
            try:
                self._node.close()
            finally:
                heartbeat.close()

    def stop(self) -> None:
        """End `run`; may be called from a signal handler or another thread."""
        self._stopped = True
        self.inbox.wake()

    def _tell_node(self, hook: str, value: object) -> None:
        tell: Callable[[object], None] | None = getattr(self._node, hook, None)
        if tell:
            tell(value)

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
            outputs, spans = self._ask(lambda: self._node.tick(time.monotonic_ns()))
            self._publish(outputs, spans)
            status = self._node.status()
            if status.state == "finished":
                log.info("finished%s", f": {status.reason}" if status.reason else "")
                return

    def _drain(self) -> None:
        while arrival := self.inbox.get(0.0):
            self._handle(arrival)

    def _flush(self) -> None:
        """Publish what the node still held back, waiting for more."""
        flush: Callable[[int], Sequence[Message]] | None = getattr(self._node, "flush", None)
        if flush:
            self._publish(*self._ask(lambda: flush(time.monotonic_ns())))

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
        outputs, spans = self._ask(lambda: self._node.handle(message, time.monotonic_ns()))
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
    return newest and not getattr(message, "lockstep", False)
