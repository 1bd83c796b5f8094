"""Owners of keys: only the owner of a key may send messages with a lasting effect."""

import threading
from collections import Counter
from dataclasses import dataclass

import msgspec

from people4d.codec import decode, encode
from people4d.errors import DecodeError
from people4d.queue import RefusedPayload
from people4d.topics import Topic

FOREIGN = "foreign"  # prefix of the counter of refused messages of a topic
SESSIONS_MAX = 4096  # maximum number of announced sessions, a bound against invented ones
OTHERS_MAX = 256  # maximum number of awaited sessions, a bound against invented ones
TOKEN_S = 0.5  # maximum wait for the token of a session [s]


class Announcements:
    """Sessions of the announced processes of a robot, and keys published by this session.

    A process announces its session by a token alive/<service>/<instance>/<session>, which vanishes
    with the process.
    """

    def __init__(self) -> None:
        self.own: dict[str, tuple[str, bytes]] = {}  # session and last payload, by key
        self._services: dict[str, set[str]] = {}  # services of each session
        self._running: Counter[str] = Counter()  # number of sessions by service
        self._others: set[str] = set()  # awaited sessions
        self._changed = threading.Condition()

    def update_token(self, token: str, is_present: bool) -> None:
        """Add or remove a token."""
        *_, service, _, session = token.split("/")
        with self._changed:
            services = self._services.get(session, set())
            if not is_present and service in services:
                services.remove(service)
                self._running[service] -= 1
            elif is_present and service not in services and len(self._services) < SESSIONS_MAX:
                self._services.setdefault(session, services).add(service)
                self._running[service] += 1
            if not services:
                self._services.pop(session, None)
            self._changed.notify_all()

    def publishes(self, session: str, topic: Topic) -> bool:
        """Check that a session belongs to a producer of a topic."""
        with self._changed:
            return not topic.producers.isdisjoint(self._services.get(session, ()))

    def admits(self, session: str, topic: Topic) -> bool:
        """Check that a session may publish a topic; without an announced producer all may."""
        with self._changed:
            if session and session not in self._services and len(self._others) < OTHERS_MAX:
                is_new = session not in self._others
                self._others.add(session)
                if is_new and self._has_producer(topic):
                    # Its token arrives in another thread than its first message.
                    self._changed.wait_for(lambda: session in self._services, TOKEN_S)
            if not self._has_producer(topic):
                return True
        return self.publishes(session, topic)

    def _has_producer(self, topic: Topic) -> bool:
        # The first producer: visual odometry is silent if another odometry arrives.
        return self._running[topic.producer.split()[0]] > 0


@dataclass(frozen=True)
class _Accepted:
    """The last payload of a key."""

    session: str  # session of the sender; empty: unknown
    payload: int = 0  # hash of the bytes
    content: int = 0  # hash of the content without stamp, number and trace


NOTHING = _Accepted("")


class KeyOwners:
    """Owners of the keys of one subscription.

    While a producer of the topic is announced, messages of all other programs are refused. A key of
    a latched topic belongs to the sender of its last message while that process lives. Owners
    repeat latched messages, which replaces earlier forged ones; a repetition of the last message is
    skipped.
    """

    def __init__(self, topic: Topic, announcements: Announcements) -> None:
        self._topic, self._announcements = topic, announcements
        self._accepted: dict[str, _Accepted] = {}  # last payload by key

    def receive(self, key: str, session: str, payload: bytes) -> list[bytes]:
        """Return an accepted payload, a `RefusedPayload`, or nothing for a repetition."""
        latched, owner = self._topic.delivery == "latched", self._owner(key)
        if not self._announcements.admits(session, self._topic):
            return self._refused(key, payload, owner)
        if not latched:
            return [payload]
        if session != owner.session and self._announcements.publishes(owner.session, self._topic):
            return self._refused(key, payload, owner)
        if session and session == owner.session and owner.payload == hash(payload):
            return []
        self._accepted[key] = _Accepted(session, hash(payload), _content(payload))
        self._forget()
        return [payload]

    def _refused(self, key: str, payload: bytes, owner: _Accepted) -> list[bytes]:
        if owner.content and _content(payload) == owner.content:
            return []
        reason = f"another process sends {key} than its owner"
        return [RefusedPayload(reason, counter=FOREIGN)]

    def _owner(self, key: str) -> _Accepted:
        own = self._announcements.own.get(key)
        if own:  # message from this process
            return _Accepted(own[0], content=_content(own[1]))
        return self._accepted.get(key, NOTHING)

    def _forget(self) -> None:
        """Forget keys without an owner if there are too many."""
        if len(self._accepted) > 2 * self._topic.keys_max:
            self._accepted = {
                key: one
                for key, one in self._accepted.items()
                if self._announcements.publishes(one.session, self._topic)
            }


def _content(payload: bytes) -> int:
    """Return the hash of a message without stamp, number and trace."""
    try:
        message = decode(payload)
    except DecodeError:
        return hash(payload)
    return hash(encode(msgspec.structs.replace(message, stamp_ns=0, sequence=0, trace=())))
