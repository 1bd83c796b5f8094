"""People for consumers of ROS, with integer ids, yaw and its rate, group and age."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.geometry.transforms import wrap
from common.transport.stream_clock import EXTRAPOLATION_MAX_NS
from people4d.messages import F64, Track, Tracks, Truth, TruthPerson

MOVING_MPS = 0.1  # minimum speed of a moving person, as in nav2_social_costmap_plugin [m/s]
FORGOTTEN_S = 5.0  # maximum absence of a remembered person [s]
RATE_S = 0.4  # time constant of the yaw rate [s]
RATE_MAX_RADPS = 3.0
ALONE = -1  # group of a person without a group


@dataclass(slots=True)  # not frozen: frozen ones take three times as long to create
class RosPerson:
    """One person at the stamp of `RosPeople`, never changed."""

    id: int  # unique number
    slot: int  # number in the message, from 1 to its number of people
    group: int  # number of the group; ALONE without a group
    name: str  # identity as text
    state: str  # state of the track, or "truth"
    position_m: tuple[float, float, float]
    velocity_mps: tuple[float, float, float]
    covariance: F64  # 6x6, of position and velocity [m, m/s]; zero if unknown
    yaw_rad: float  # yaw of the chest; if unknown, direction of walking, else 0
    yaw_known: bool
    yaw_rate_radps: float
    age_s: float  # time since the first message with this person
    detection: int | None  # index in the Detections of this stamp
    score: float  # 0 to 1
    path_yaw_rad: float | None = None  # direction of walking, from truth

    @property
    def moves(self) -> bool:
        """True if the person moves."""
        return math.hypot(*self.velocity_mps[:2]) >= MOVING_MPS


@dataclass(frozen=True, slots=True)
class RosPeople:
    """People of one message."""

    stamp_ns: int
    frame_id: str
    people: tuple[RosPerson, ...]

    def at(self, stamp_ns: int) -> "RosPeople | None":
        """Return the people at another time; None beyond EXTRAPOLATION_MAX_NS."""
        if abs(stamp_ns - self.stamp_ns) > EXTRAPOLATION_MAX_NS:
            return None
        dt_s = (stamp_ns - self.stamp_ns) / 1e9
        moved = (
            replace(
                person,
                position_m=_moved(person.position_m, person.velocity_mps, dt_s),
                yaw_rad=wrap(person.yaw_rad + person.yaw_rate_radps * dt_s),
            )
            for person in self.people
        )
        return RosPeople(stamp_ns, self.frame_id, tuple(moved))

    def transformed(self, target_from_source: F64, frame_id: str) -> "RosPeople":
        """Transform people to another frame. Both frames have a vertical z axis."""
        rotation, turn_rad = target_from_source[:3, :3], yaw_of(target_from_source)
        both = np.kron(np.eye(2), rotation)
        turned = (
            replace(
                person,
                position_m=_triple(rotation @ person.position_m + target_from_source[:3, 3]),
                velocity_mps=_triple(rotation @ person.velocity_mps),
                covariance=both @ person.covariance @ both.T,
                yaw_rad=wrap(person.yaw_rad + turn_rad),
            )
            for person in self.people
        )
        return RosPeople(self.stamp_ns, frame_id, tuple(turned))


def yaw_of(transform: F64) -> float:
    """Return the rotation of a 4x4 transform about z."""
    return math.atan2(transform[1, 0], transform[0, 0])


@dataclass(slots=True)
class _Memory:
    """Past of a person."""

    number: int
    slot: int
    first_ns: int
    stamp_ns: int
    yaw_rad: float | None
    rate_radps: float = 0.0


class RosPeopleView:
    """Converts messages in the order of their stamps to RosPeople, with a memory of people."""

    def __init__(self) -> None:
        self._memories: dict[str, _Memory] = {}
        self._numbers = 0  # number of identities that are not numbers

    def tracks(
        self, message: Tracks, groups: Mapping[int, int], states: Sequence[str] = ()
    ) -> RosPeople:
        """Return tracks in `states` (empty: all states), with groups by id."""
        tracks = [one for one in message.tracks if not states or one.state in states]
        return self._people(message, tracks, [groups.get(one.id, ALONE) for one in tracks])

    def truth(self, message: Truth) -> RosPeople:
        """Return truth; identities that are not numbers are numbered."""
        return self._people(message, message.people, [ALONE] * len(message.people))

    def _people(
        self, message: Tracks | Truth, sources: Sequence[Track | TruthPerson], groups: Sequence[int]
    ) -> RosPeople:
        names, yaws_rad = [str(one.id) for one in sources], [one.yaw_rad for one in sources]
        memories = self._update(message.stamp_ns, names, yaws_rad)
        people = (
            self._person(message.stamp_ns, *one)
            for one in zip(memories, sources, groups, strict=True)
        )
        return RosPeople(message.stamp_ns, message.frame_id, tuple(people))

    def _person(
        self, stamp_ns: int, memory: _Memory, source: Track | TruthPerson, group: int
    ) -> RosPerson:
        speed = source.velocity_mps
        velocity = (0.0, 0.0, 0.0) if speed is None else _triple(speed)
        yaw_rad = source.yaw_rad
        if yaw_rad is None:
            moves = math.hypot(*velocity[:2]) >= MOVING_MPS
            yaw_rad = math.atan2(velocity[1], velocity[0]) if moves else 0.0
        track = source if isinstance(source, Track) else None
        return RosPerson(
            id=memory.number,
            slot=memory.slot,
            group=group,
            name=str(source.id),
            state=track.state if track else "truth",
            position_m=_triple(source.position_m),
            velocity_mps=velocity,
            covariance=track.covariance if track else np.zeros((6, 6)),
            yaw_rad=yaw_rad,
            yaw_known=source.yaw_rad is not None,
            yaw_rate_radps=memory.rate_radps,
            age_s=max(stamp_ns - memory.first_ns, 0) / 1e9,
            detection=track.detection if track else None,
            score=track.score if track else 1.0,
            path_yaw_rad=None if isinstance(source, Track) else source.path_yaw_rad,
        )

    def _update(
        self, stamp_ns: int, names: Sequence[str], yaws_rad: Sequence[float | None]
    ) -> list[_Memory]:
        """Return the memories of the people of a message, updated to its time."""
        if len(self._memories) > len(names):
            self._forget(stamp_ns, set(names))
        memories = [
            self._remember(name, stamp_ns, yaw_rad)
            for name, yaw_rad in zip(names, yaws_rad, strict=True)
        ]
        _assign_slots(memories)
        return memories

    def _forget(self, stamp_ns: int, present: Collection[str]) -> None:
        """Delete people after a long absence, or a restart of the recording."""
        old_ns, next_ns = stamp_ns - round(FORGOTTEN_S * 1e9), stamp_ns + EXTRAPOLATION_MAX_NS
        self._memories = {
            name: memory
            for name, memory in self._memories.items()
            if name in present or old_ns <= memory.stamp_ns <= next_ns
        }

    def _remember(self, name: str, stamp_ns: int, yaw_rad: float | None) -> _Memory:
        memory = self._memories.get(name)
        # A frame may be slightly older than a frame of another camera or a prediction. A much older
        # one shows a restarted recording.
        if memory is None or memory.stamp_ns - stamp_ns > EXTRAPOLATION_MAX_NS:
            number = memory.number if memory else self._number(name)
            memory = _Memory(number, 0, stamp_ns, stamp_ns, yaw_rad)
            self._memories[name] = memory
            return memory
        dt_s = (stamp_ns - memory.stamp_ns) / 1e9
        if yaw_rad is None or memory.yaw_rad is None:
            memory.rate_radps = 0.0
        elif dt_s > 0:
            rate = wrap(yaw_rad - memory.yaw_rad) / dt_s
            rate = min(max(rate, -RATE_MAX_RADPS), RATE_MAX_RADPS)
            memory.rate_radps += (rate - memory.rate_radps) * -math.expm1(-dt_s / RATE_S)
        memory.stamp_ns, memory.yaw_rad = stamp_ns, yaw_rad
        return memory

    def _number(self, name: str) -> int:
        """Return the number of a new person: the identity if it is a number within int32."""
        if name.isascii() and name.isdecimal() and int(name) < 2**31:
            return int(name)
        self._numbers += 1
        return 10**9 + self._numbers


def _assign_slots(memories: Sequence[_Memory]) -> None:
    """Assign slots from 1 to the number of people, unchanged where possible."""
    free = set(range(1, len(memories) + 1))
    seekers = []
    for memory in memories:
        if memory.slot in free:
            free.remove(memory.slot)
        else:
            seekers.append(memory)
    for memory, slot in zip(seekers, sorted(free), strict=True):
        memory.slot = slot


def _moved(
    position: tuple[float, float, float], velocity: tuple[float, float, float], dt_s: float
) -> tuple[float, float, float]:
    (x, y, z), (vx, vy, vz) = position, velocity
    return x + vx * dt_s, y + vy * dt_s, z + vz * dt_s


def _triple(values: F64) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
