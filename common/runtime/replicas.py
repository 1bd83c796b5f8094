"""One replica of a service, and its contact with the other replicas."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace

import msgspec

from common.runtime.assignment import Assignment, PendingMessage, read_header
from common.runtime.heartbeat import Activity
from common.runtime.inbox import Inbox
from common.runtime.node import Sharing
from common.transport.trace import ProcessId
from common.transport.zenoh_bus import ZenohBus
from people4d.messages import Health
from people4d.subscription import ZenohSubscription
from people4d.topics import BY_MESSAGE, Topic

# Pause between subscribing and joining: messages must not be assigned to this replica earlier [s]
SETTLE_S = 0.2
CHECK_PERIOD_S = 0.1  # period of the checks for silent replicas [s]
STUCK_S = 1.0  # minimum time with one message before a replica withdraws [s]
# Minimum multiple of the longest recent duration after which a replica withdraws
STUCK_FACTOR = 2.0
LONGEST_DECAY = 0.95  # decay of the longest duration per message


class Liveness(msgspec.Struct, frozen=True):
    """Fields of a heartbeat that other replicas read."""

    instance: str
    state: str


_LIVENESS = msgspec.msgpack.Decoder(Liveness)


class Replica:
    """Member of the replicas of a service; takes over the work of failed replicas."""

    def __init__(
        self, bus: ZenohBus, process_id: ProcessId, sharing: Sharing, activity: Activity
    ) -> None:
        self.assignment = Assignment(process_id.instance, sharing)
        self._bus, self._sharing, self._activity = bus, sharing, activity
        self._service, self._name = process_id.service, process_id.instance
        self._subscriptions: list[ZenohSubscription] = []
        self._left = threading.Event()
        self._changing = threading.Lock()
        self._joined = False
        self._longest_s = 0.0

    def join(self, inbox: Inbox) -> None:
        """Join the other replicas; called when the work is subscribed."""
        self._inbox = inbox
        health = replace(BY_MESSAGE[Health], key=f"health/{self._service}/{{instance}}")
        self._follow(health, self._take_heartbeat)
        self._follow(BY_MESSAGE[self._sharing.answer], self._take_answer)
        members = self._bus.members(self._service)
        self._subscriptions.append(members)
        _start(lambda: self._watch(members))
        self._left.wait(SETTLE_S)
        self._announce()
        _start(self._check)

    def names(self) -> tuple[str, tuple[str, ...]]:
        """Return the name of this process and the names of all live replicas."""
        return self._name, self.assignment.replicas

    def note_duration(self, duration_s: float) -> None:
        """Record the duration of a message's handling."""
        self._longest_s = max(duration_s, LONGEST_DECAY * self._longest_s)

    def leave(self) -> None:
        """Hand the work to other replicas for good; received messages are still handled."""
        self._left.set()
        self._withdraw()
        for subscription in self._subscriptions:
            subscription.close()

    def _announce(self) -> None:
        with self._changing:
            if self._joined or self._left.is_set():
                return
            self._joined = True
            # First here, then at the others: duplicate handling is better than a lost message.
            self._take_over(self.assignment.add_replica(self._name, time.monotonic()))
            self._bus.announce(self._service, self._name)

    def _withdraw(self) -> None:
        with self._changing:
            if not self._joined:
                return
            self._joined = False
            self._bus.withdraw(self._service)
            self.assignment.remove_replica(self._name, time.monotonic())

    def _watch(self, members: ZenohSubscription) -> None:
        for key, is_present in members.tokens():
            name, assignment = key.rpartition("/")[2], self.assignment
            if name != self._name:
                change = assignment.add_replica if is_present else assignment.remove_replica
                self._take_over(change(name, time.monotonic()))

    def _check(self) -> None:
        """Check periodically for replicas that are stuck, this process included."""
        checked_s = time.monotonic()
        while not self._left.wait(CHECK_PERIOD_S):
            now_s = time.monotonic()
            paused_s, checked_s = max(now_s - checked_s - 2 * CHECK_PERIOD_S, 0.0), now_s
            stuck_s = max(STUCK_S, STUCK_FACTOR * self._longest_s)
            if self._activity.longest_busy_s() > stuck_s:
                self._withdraw()
            else:
                self._announce()
            self._take_over(self.assignment.reassign(now_s, paused_s))

    def _take_heartbeat(self, payload: bytes) -> None:
        try:
            liveness = _LIVENESS.decode(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return
        stalled = liveness.state == "stalled"
        ours = self.assignment.note_heartbeat(liveness.instance, stalled, time.monotonic())
        self._take_over(ours)

    def _take_answer(self, payload: bytes) -> None:
        header = read_header(payload)
        if header:
            self.assignment.answered(header)

    def _take_over(self, messages: list[PendingMessage]) -> None:
        for message in messages:
            self._inbox.take_over(message)

    def _follow(self, topic: Topic, take: Callable[[bytes], None]) -> None:
        subscription = self._bus.subscribe(topic, own=False)
        self._subscriptions.append(subscription)

        def receive() -> None:
            for _, payload in subscription:
                take(payload)
                del payload  # frees memory before the next payload

        _start(receive)


def _start(target: Callable[[], None]) -> None:
    threading.Thread(target=target, name="replica", daemon=True).start()
