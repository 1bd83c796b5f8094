"""One process of a service that may have several: in touch with the others."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace

import msgspec

from common.runtime.heartbeat import Work
from common.runtime.inbox import Inbox
from common.runtime.node import Sharing
from common.runtime.process_id import Place
from common.runtime.sharing import Share, Spare, head_of
from common.runtime.team import Team
from common.transport.bus import Bus, Members, Subscription
from people4d.messages import Health
from people4d.topics import BY_MESSAGE, Topic

SETTLE_S = 0.2  # [s] between subscribing and joining: who counts on us must not do so too early
LOOK_S = 0.1  # [s] between two looks for who has become silent
STUCK_S = 1.0  # [s] at one message after which a replica gives its share away
STUCK_FACTOR = 2.0  # and so many times the longest of late
FORGET = 0.95  # per message, of the longest of late


class Sign(msgspec.Struct, frozen=True):
    """What a heartbeat tells the other replicas."""

    instance: str
    state: str


_SIGN = msgspec.msgpack.Decoder(Sign)


class Replica:
    """Knows this process's share of the work, and takes over the work of others that fail.

    Args:
        bus: Where the others are.
        place: Which process this is.
        sharing: What is shared.
        work: What shows whether this process is stuck.
    """

    def __init__(self, bus: Bus, place: Place, sharing: Sharing, work: Work) -> None:
        self._bus, self._place, self._sharing, self._work = bus, place, sharing, work
        self.share = Share(Team(place.instance), place.instance, sharing)
        self._subscriptions: list[Subscription | Members] = []
        self._left = threading.Event()
        self._changing = threading.Lock()
        self._joined = False
        self._longest_s = 0.0

    def join(self, inbox: Inbox) -> None:
        """Take a share from now on; called when the work is subscribed.

        Args:
            inbox: Where messages go that are taken over.
        """
        self._inbox = inbox
        service = self._place.service
        health = replace(BY_MESSAGE[Health], key=f"health/{service}/{{instance}}")
        self._follow(health, self._heard)
        self._follow(BY_MESSAGE[self._sharing.answer], self._answered)
        members = self._bus.members(service)
        self._subscriptions.append(members)
        _start(lambda: self._watch(members))
        self._left.wait(SETTLE_S)
        self._announce()
        _start(self._look)

    def all(self) -> tuple[str, tuple[str, ...]]:
        """Return the name of this process, and those of all that share the work now."""
        return self._place.instance, self.share.members

    def worked(self, duration_s: float) -> None:
        """Note how long a message took."""
        self._longest_s = max(duration_s, FORGET * self._longest_s)

    def leave(self) -> None:
        """Give the share to the others for good; what was received is still worked off."""
        self._left.set()
        self._withdraw()
        for subscription in self._subscriptions:
            subscription.close()

    def _announce(self) -> None:
        with self._changing:
            if self._joined or self._left.is_set():
                return
            self._joined = True
            # First here, then there: work that nobody takes is worse than work done twice.
            ours = self.share.came(self._place.instance, self._place.capacity, time.monotonic())
            self._take_over(ours)
            self._bus.announce(self._place.service, self._place.instance, self._place.capacity)

    def _withdraw(self) -> None:
        with self._changing:
            if not self._joined:
                return
            self._joined = False
            self._bus.withdraw()
            self.share.went(self._place.instance, self._place.capacity, time.monotonic())

    def _watch(self, members: Members) -> None:
        for member in members:
            if member.instance != self._place.instance:
                note = self.share.came if member.there else self.share.went
                self._take_over(note(member.instance, member.capacity, time.monotonic()))

    def _look(self) -> None:
        """Look again and again who does not get on, this process included."""
        looked_s = time.monotonic()
        while not self._left.wait(LOOK_S):
            now_s = time.monotonic()
            paused_s, looked_s = max(now_s - looked_s - 2 * LOOK_S, 0.0), now_s
            stuck_s = max(STUCK_S, STUCK_FACTOR * self._longest_s)
            if self._work.longest_s() > stuck_s:
                self._withdraw()
            else:
                self._announce()
            self._take_over(self.share.redivide(now_s, paused_s))

    def _heard(self, payload: bytes) -> None:
        try:
            sign = _SIGN.decode(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return
        works = sign.state != "stalled"
        self._take_over(self.share.heard(sign.instance, works, time.monotonic()))

    def _answered(self, payload: bytes) -> None:
        head = head_of(payload)
        if head:
            self.share.answered(head)

    def _take_over(self, spares: list[Spare]) -> None:
        for spare in spares:
            self._inbox.take_over(spare)

    def _follow(self, topic: Topic, note: Callable[[bytes], None]) -> None:
        subscription = self._bus.subscribe(topic, own=False)
        self._subscriptions.append(subscription)

        def receive() -> None:
            for _, payload in subscription:
                note(payload)

        _start(receive)


def _start(target: Callable[[], None]) -> None:
    threading.Thread(target=target, name="replica", daemon=True).start()
