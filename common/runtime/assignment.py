"""Assignment of messages to the replicas of a service, and take-over from failed replicas.

Every replica receives every message. Messages of another replica stay encoded and pending until its
answer is received, so the work of a failed replica is taken over without retransmission.
"""

import threading
import zlib
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec

from common.runtime.node import Sharing
from people4d.messages import Message
from people4d.topics import BY_MESSAGE, Topic

SILENT_S = 1.2  # maximum silence of a live replica; heartbeats come twice a second [s]
REPLICAS_MAX = 16  # maximum number of replicas, a bound against invented names
# A replica that answers no message is excluded, even if its heartbeats continue
UNANSWERED_MIN = 3  # minimum number of unanswered messages
UNANSWERED_S = 5.0  # minimum time since the first unanswered message [s]
EXCLUDED_S = 60.0  # duration of the exclusion [s]
# Replicas that have not answered yet are tried a few at a time, so invented ones lose few frames
TRIED_MAX = 2  # maximum number of replicas on trial
TRIED_S = 3.0  # maximum time until their first answer [s]


class MessageHeader(msgspec.Struct, frozen=True):
    """Fields of a message that determine its replica."""

    camera: str
    sequence: int
    lockstep: bool = False


_HEADER = msgspec.msgpack.Decoder(MessageHeader)


def read_header(payload: bytes) -> MessageHeader | None:
    """Read only the header of a message; None if the bytes have none."""
    try:
        return _HEADER.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


def header_of(message: Message) -> MessageHeader:
    """Return the header of a message; the camera is empty if the message has none."""
    fields = msgspec.structs.asdict(message)
    return MessageHeader(
        camera=fields.get("camera", ""),
        sequence=message.sequence,
        lockstep=fields.get("lockstep", False),
    )


@dataclass(frozen=True, eq=False)
class PendingMessage:
    """A message that another replica handles."""

    key: str  # full key of the message
    payload: bytes | Message  # encoded message; decoded if published by this process
    received_ns: int  # wall clock of arrival
    header: MessageHeader  # fields of the message that determine its replica


def assigned_replica(replicas: Sequence[str], camera: str, sequence: int) -> str | None:
    """Return the replica that handles a message, None if there is none.

    Round-robin gives each replica frames at equal intervals. Rendezvous hashing would often give
    one replica two frames in a row; its stability under changes of replicas is no use to stateless
    nodes.

    Args:
        replicas: Names of the live replicas, sorted.
        camera: Name of the camera. Each camera begins with another replica, which spreads frames of
            synchronised cameras.
        sequence: Number of the message.
    """
    if not replicas:
        return None
    return replicas[(sequence + zlib.crc32(camera.encode())) % len(replicas)]


class Membership:
    """Live replicas, by liveliness tokens and heartbeats.

    A token vanishes within milliseconds of the end of its process. A hanging process keeps its
    token, but sends no heartbeats. A replica with token and heartbeats that does not answer is
    excluded for EXCLUDED_S; only TRIED_MAX replicas that have not answered yet are tried at a
    time. This process is live while it has a token.
    """

    def __init__(self, own_name: str) -> None:
        self.replicas: tuple[str, ...] = ()  # names of live replicas, sorted
        self._own_name = own_name
        self._announced: set[str] = set()
        self._heartbeats_s: dict[str, float] = {}  # time of the last heartbeat, by name
        self._stalled: set[str] = set()
        # Number of unanswered messages and time of the first, by name
        self._unanswered: dict[str, tuple[int, float]] = {}
        self._excluded_s: dict[str, float] = {}  # time of exclusion, by name
        self._proven: set[str] = set()  # replicas with an answer

    def add_replica(self, name: str, now_s: float) -> None:
        """Record the token of a replica."""
        if len(self._announced) >= REPLICAS_MAX and name not in {*self._announced, self._own_name}:
            return
        self._announced.add(name)
        self._heartbeats_s[name] = now_s
        self._stalled.discard(name)

    def remove_replica(self, name: str) -> None:
        """Record the loss of a replica's token."""
        self._announced.discard(name)
        self._proven.discard(name)
        for notes in (self._heartbeats_s, self._unanswered, self._excluded_s):
            notes.pop(name, None)

    def note_assigned(self, name: str, now_s: float) -> None:
        """Record a message assigned to another replica."""
        count, first_s = self._unanswered.get(name, (0, now_s))
        self._unanswered[name] = count + 1, first_s
        unanswered, longest_s = (
            (UNANSWERED_MIN, UNANSWERED_S) if name in self._proven else (1, TRIED_S)
        )
        if count + 1 >= unanswered and now_s - first_s > longest_s:
            self._excluded_s[name] = now_s
            del self._unanswered[name]

    def note_answered(self, name: str) -> None:
        """Record an answer of a replica."""
        self._unanswered.pop(name, None)
        if name in self._announced:
            self._proven.add(name)

    def note_heartbeat(self, name: str, stalled: bool, now_s: float) -> None:
        """Record a heartbeat.

        Args:
            name: Name of the replica.
            stalled: State in the heartbeat.
            now_s: Monotonic time in seconds.
        """
        if name not in self._announced:
            return
        self._heartbeats_s[name] = now_s
        (self._stalled.add if stalled else self._stalled.discard)(name)

    def extend_deadlines(self, duration_s: float) -> None:
        """Extend all deadlines by a suspension of this process."""
        self._heartbeats_s = {name: s + duration_s for name, s in self._heartbeats_s.items()}

    def update_replicas(self, now_s: float) -> bool:
        """Find the live replicas; return True if they have changed."""
        live = sorted(name for name in self._announced if self._is_live(name, now_s))
        known = {name for name in live if name in self._proven or name == self._own_name}
        tried = [name for name in live if name not in known][:TRIED_MAX]
        replicas = tuple(sorted([*known, *tried]))
        changed, self.replicas = replicas != self.replicas, replicas
        return changed

    def _is_live(self, name: str, now_s: float) -> bool:
        if name == self._own_name:
            return True
        excluded_s = self._excluded_s.get(name)
        if excluded_s is not None and now_s - excluded_s < EXCLUDED_S:
            return False
        return name not in self._stalled and now_s - self._heartbeats_s[name] < SILENT_S


class Assignment:
    """Divides messages between this and other replicas, whose messages are pending; thread-safe."""

    def __init__(self, own_name: str, sharing: Sharing) -> None:
        self.topic: Topic = BY_MESSAGE[sharing.work]
        self._membership = Membership(own_name)
        self._own_name = own_name
        self._lock = threading.Lock()
        self._pending: dict[str, deque[PendingMessage]] = {}
        self._newest: dict[str, int] = {}  # sequence of this replica's last message, by key

    @property
    def replicas(self) -> tuple[str, ...]:
        """Names of the live replicas, sorted."""
        return self._membership.replicas

    def is_ours(self, message: PendingMessage, now_s: float) -> bool:
        """Assign a message; it becomes pending if it is assigned to another replica."""
        with self._lock:
            name = self._assigned(message)
            if name == self._own_name:
                self._newest[message.key] = message.header.sequence
            else:
                if name:
                    self._membership.note_assigned(name, now_s)
                self._add_pending(message)
            return name == self._own_name

    def answered(self, header: MessageHeader) -> None:
        """Delete the pending message that another replica has answered."""
        with self._lock:
            name = assigned_replica(self._membership.replicas, header.camera, header.sequence)
            if name:
                self._membership.note_answered(name)
            for key, pending in self._pending.items():
                self._pending[key] = deque(m for m in pending if not _same(m.header, header))

    def add_replica(self, name: str, now_s: float) -> list[PendingMessage]:
        """Record the token of a replica; return pending messages now assigned to this one."""
        with self._lock:
            self._membership.add_replica(name, now_s)
            return self._reassigned(now_s)

    def remove_replica(self, name: str, now_s: float) -> list[PendingMessage]:
        """Record the loss of a token; return pending messages now assigned to this replica."""
        with self._lock:
            self._membership.remove_replica(name)
            return self._reassigned(now_s)

    def note_heartbeat(self, name: str, stalled: bool, now_s: float) -> list[PendingMessage]:
        """Record the heartbeat of a replica; return pending messages now assigned to this one."""
        with self._lock:
            self._membership.note_heartbeat(name, stalled, now_s)
            return self._reassigned(now_s)

    def reassign(self, now_s: float, paused_s: float = 0.0) -> list[PendingMessage]:
        """Return pending messages taken over from silent replicas.

        Args:
            now_s: Monotonic time in seconds.
            paused_s: Duration of a recent suspension of this process, without heartbeats [s].
        """
        with self._lock:
            self._membership.extend_deadlines(paused_s)
            return self._reassigned(now_s)

    def _assigned(self, message: PendingMessage) -> str | None:
        header = message.header
        return assigned_replica(self._membership.replicas, header.camera, header.sequence)

    def _add_pending(self, message: PendingMessage) -> None:
        pending = self._pending.setdefault(message.key, deque())
        pending.append(message)
        while len(pending) > (1 if self._may_skip(message) else self.topic.depth):
            pending.popleft()

    def _reassigned(self, now_s: float) -> list[PendingMessage]:
        """Return the pending messages now assigned to this replica."""
        if not self._membership.update_replicas(now_s):
            return []
        ours = []
        for key, pending in self._pending.items():
            mine = [m for m in pending if self._is_taken_over(m)]
            self._pending[key] = deque(m for m in pending if m not in mine)
            ours += mine
        return ours

    def _is_taken_over(self, message: PendingMessage) -> bool:
        if self._assigned(message) != self._own_name:
            return False
        # A replaceable message is taken over only if it is newer than this replica's last one.
        newest = self._newest.get(message.key, -1)
        return not self._may_skip(message) or message.header.sequence > newest

    def _may_skip(self, message: PendingMessage) -> bool:
        return self.topic.may_be_replaced(message.header)


def _same(one: MessageHeader, other: MessageHeader) -> bool:
    return (one.camera, one.sequence) == (other.camera, other.sequence)
