"""Work that the replicas of a service share: what is ours to do, and what we may have to take over.

Every replica receives every message. What is another's is not even decoded, but kept until that
one's answer is heard, so that the work of a replica that dies is taken over without anybody
sending it again.
"""

import threading
from collections import deque
from dataclasses import dataclass

import msgspec

from common.runtime.node import Sharing
from common.runtime.team import Team
from people4d.topics import BY_MESSAGE, Topic


class Head(msgspec.Struct, frozen=True):
    """The fields of a message that say whose it is."""

    camera: str
    sequence: int
    lockstep: bool = False


_HEAD = msgspec.msgpack.Decoder(Head)


def head_of(payload: bytes) -> Head | None:
    """Read the head only, whatever else a message holds; None if there is none."""
    try:
        return _HEAD.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


@dataclass(frozen=True)
class Spare:
    """A message that another replica does.

    Args:
        key: Full key that it came on.
        payload: Its bytes.
        received_ns: Wall clock when they came.
        head: Whose it is.
    """

    key: str
    payload: bytes
    received_ns: int
    head: Head


class Share:
    """Divides messages into ours and others'; may be called from several threads.

    Args:
        team: Who lives.
        me: Name of this replica.
        sharing: What is shared.
    """

    def __init__(self, team: Team, me: str, sharing: Sharing) -> None:
        self.topic: Topic = BY_MESSAGE[sharing.work]
        self._team = team
        self._me = me
        self._lock = threading.Lock()
        self._spares: dict[str, deque[Spare]] = {}
        self._newest: dict[str, int] = {}  # sequence of our last message, by key

    def is_ours(self, message: Spare) -> bool:
        """Decide who does a message that came; keep it if it is another's."""
        with self._lock:
            ours = self._team.does(message.head.camera, message.head.sequence) == self._me
            if ours:
                self._newest[message.key] = message.head.sequence
            else:
                self._keep(message)
            return ours

    def answered(self, head: Head) -> None:
        """Forget a message that another replica has done."""
        with self._lock:
            for spares in self._spares.values():
                done = [s for s in spares if _same(s.head, head)]
                for spare in done:
                    spares.remove(spare)

    def came(self, name: str, capacity: int, now_s: float) -> list[Spare]:
        """Note a token of a replica; return what is ours by that."""
        with self._lock:
            self._team.came(name, capacity, now_s)
            return self._redivided(now_s)

    def went(self, name: str, capacity: int, now_s: float) -> list[Spare]:
        """Note that a token vanished; return what is ours by that."""
        with self._lock:
            self._team.went(name, capacity)
            return self._redivided(now_s)

    def heard(self, name: str, works: bool, now_s: float) -> list[Spare]:
        """Note a heartbeat of a replica; return what is ours by that."""
        with self._lock:
            self._team.heard(name, works, now_s)
            return self._redivided(now_s)

    def redivide(self, now_s: float, paused_s: float = 0.0) -> list[Spare]:
        """Return what is ours because others have been silent too long.

        Args:
            now_s: Monotonic time in seconds.
            paused_s: How long of late this process did not run, and so heard nobody.
        """
        with self._lock:
            self._team.excuse(paused_s)
            return self._redivided(now_s)

    @property
    def members(self) -> tuple[str, ...]:
        """Names of those who live, sorted."""
        return tuple(sorted(set(self._team.order)))

    def _keep(self, message: Spare) -> None:
        spares = self._spares.setdefault(message.key, deque())
        spares.append(message)
        while len(spares) > (1 if self._may_skip(message) else self.topic.depth):
            spares.popleft()

    def _redivided(self, now_s: float) -> list[Spare]:
        """Return the spares that are ours now. What was ours stays so: who joins never got it."""
        if not self._team.update(now_s):
            return []
        ours = []
        for key, spares in self._spares.items():
            mine = [s for s in spares if self._is_taken_over(s)]
            self._spares[key] = deque(s for s in spares if s not in mine)
            ours += mine
        return ours

    def _is_taken_over(self, spare: Spare) -> bool:
        if self._team.does(spare.head.camera, spare.head.sequence) != self._me:
            return False
        # Of what may be skipped only what is newer than the last is worth it.
        return not self._may_skip(spare) or spare.head.sequence > self._newest.get(spare.key, -1)

    def _may_skip(self, spare: Spare) -> bool:
        return self.topic.delivery == "newest" and not spare.head.lockstep


def _same(one: Head, other: Head) -> bool:
    return (one.camera, one.sequence) == (other.camera, other.sequence)
