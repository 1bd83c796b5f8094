"""Rules that derive events from tracks.

The state follows from the events alone. `apply` replays them, so a process continues from the
journal of its predecessor without duplicate events.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from common.geometry.transforms import wrap
from common.held import HeldCondition
from people4d.messages import F64, Event, Track, Tracks, Zone
from people4d.messages.base import MAX_STAMP_NS
from services.events.config import EventsConfig

GONE_MAX = 10_000  # maximum number of stored identities of disappeared people
# Maximum burst and rate of new people [Hz], which protects the journal from invented tracks
NEW_MAX, NEW_HZ = 256, 16.0
FACING_RAD = math.radians(25)  # maximum angle between a facing person's yaw and the robot [rad]
APPROACH_MPS, APPROACH_S = 0.4, 1.0  # minimum speed towards the robot, and its duration


@dataclass(slots=True)
class _Person:
    """A tracked person."""

    stamp_ns: int  # [ns] stamp of the last track
    position_m: F64  # [m] 3
    zones: dict[str, int] = field(default_factory=dict)  # [ns] stamp of entry, by zone
    dwelled: set[str] = field(default_factory=set)  # zones with a dwell event
    is_near: bool = False
    is_uncertain: bool = False
    facing: HeldCondition = field(default_factory=HeldCondition)
    approaching: HeldCondition = field(default_factory=HeldCondition)


class EventRules:
    """Derives events from tracks; returned events are already applied.

    Attributes:
        offset_ns: Wall time minus stamps, for new events; None if unknown.
    """

    def __init__(self, config: EventsConfig) -> None:
        self._config = config
        self.offset_ns: int | None = None
        self._people: dict[int, _Person] = {}
        self._gone: dict[int, None] = {}
        self._full: set[str] = set()
        self._zones: Sequence[Zone] = ()
        self._next = 0
        self._frame_id = "map"
        self._budget, self._budget_s = float(NEW_MAX), time.monotonic()
        self.left_out = 0  # number of tracks of new people beyond the limit
        self._made: list[Event] = []

    @property
    def newest_ns(self) -> int | None:
        """Newest stamp of all tracked people; None if there are none."""
        return max((person.stamp_ns for person in self._people.values()), default=None)

    def apply(self, event: Event) -> None:
        """Apply an earlier event to the state."""
        self._next = max(self._next, event.sequence + 1)
        number = event.id
        if event.kind == "count_reached":
            self._full.add(event.zone)
            return
        if number is None:
            return
        if event.kind == "disappeared":
            self._people.pop(number, None)
            self._gone[number] = None
            if len(self._gone) > GONE_MAX:
                del self._gone[next(iter(self._gone))]
            return
        position_m = np.zeros(3) if event.position_m is None else event.position_m
        person = self._people.setdefault(number, _Person(event.stamp_ns, position_m))
        person.stamp_ns, person.position_m = event.stamp_ns, position_m
        if event.kind == "entered":
            person.zones[event.zone] = event.stamp_ns
        elif event.kind == "left":
            person.zones.pop(event.zone, None)
            person.dwelled.discard(event.zone)
            self._full.discard(event.zone)
        elif event.kind == "dwelled":
            person.dwelled.add(event.zone)
        elif event.kind == "robot_near":
            person.is_near = True
        elif event.kind == "identity_uncertain":
            person.is_uncertain = True

    def begin_numbers(self, number: int) -> None:
        """Use only numbers from this one on."""
        self._next = max(self._next, number)

    def change_zones(self, zones: Sequence[Zone]) -> None:
        """Replace the zones; people leave deleted or changed zones without an event."""
        same = {z.name for z in zones if any(_same(z, other) for other in self._zones)}
        known = {zone.name for zone in self._zones}
        for person in self._people.values():
            for name in [n for n in person.zones if n in known and n not in same]:
                del person.zones[name]
                person.dwelled.discard(name)
        self._full &= same | ({zone.name for zone in zones} - known)
        self._zones = zones

    def update(self, tracks: Tracks, robot_m: F64 | None) -> list[Event]:
        """Return the events of a message.

        Args:
            tracks: Tracks of a frame.
            robot_m: Position of the robot's base in the frame of the tracks [m]; None if unknown.
        """
        self._made, self._frame_id = [], tracks.frame_id
        stamp_ns = tracks.stamp_ns
        for track in tracks.tracks:
            if track.state == "tentative":
                continue
            if track.id not in self._people:
                if track.state == "lost" or not self._has_room():
                    continue
                self._begin(track, stamp_ns)
            person = self._people[track.id]
            person.stamp_ns, person.position_m = stamp_ns, track.position_m
            self._check_identity(track, person)
            self._check_zones(track.id, person)
            self._check_robot(track.id, person, robot_m)
            self._check_attention(track, person, robot_m)
        absent_ns = self._config.absent_s * 1e9
        for number, person in list(self._people.items()):
            if stamp_ns - person.stamp_ns > absent_ns:
                self._end(number, person)
        return self._made

    def report(self, kind: str, number: int, stamp_ns: int, **fields: Any) -> list[Event]:
        """Return an event of a person by another rule; no event if the person is unknown."""
        self._made = []
        person = self._people.get(number)
        if person is not None and stamp_ns >= person.stamp_ns:
            self._make(kind, number, replace(person, stamp_ns=stamp_ns), **fields)
        return self._made

    def close(self) -> list[Event]:
        """Return the events of all people disappearing."""
        self._made = []
        for number, person in list(self._people.items()):
            self._end(number, person)
        self._gone.clear()
        return self._made

    def _make(self, kind: Any, number: int | None, person: _Person, **fields: Any) -> None:
        wall_ns = -1 if self.offset_ns is None else person.stamp_ns + self.offset_ns
        event = Event(
            stamp_ns=person.stamp_ns,
            wall_ns=wall_ns if 0 <= wall_ns <= MAX_STAMP_NS else None,
            sequence=self._next,
            kind=kind,
            id=number,
            position_m=person.position_m,
            frame_id=self._frame_id,
            **fields,
        )
        self.apply(event)
        self._made.append(event)

    def _has_room(self) -> bool:
        """Check that the rate of new people permits one more."""
        now_s = time.monotonic()
        self._budget = min(NEW_MAX, self._budget + NEW_HZ * (now_s - self._budget_s))
        self._budget_s = now_s
        if self._budget < 1:
            self.left_out += 1
            return False
        self._budget -= 1
        return True

    def _begin(self, track: Track, stamp_ns: int) -> None:
        person = _Person(stamp_ns, track.position_m)
        returned = track.id in self._gone or track.identity == "reidentified"
        reason = track.identity_reason if returned else ""
        self._gone.pop(track.id, None)
        self._make("returned" if returned else "appeared", track.id, person, reason=reason)

    def _end(self, number: int, person: _Person) -> None:
        for name in list(person.zones):
            self._leave(number, person, name)
        self._make("disappeared", number, person)

    def _check_identity(self, track: Track, person: _Person) -> None:
        confidence = track.identity_confidence
        low = confidence is not None and confidence < self._config.uncertain_below
        if person.is_uncertain:
            if confidence is not None and confidence > self._config.certain_above:
                person.is_uncertain = False
        elif low:
            reason = track.identity_reason
            self._make(
                *("identity_uncertain", track.id, person), confidence=confidence, reason=reason
            )

    def _check_zones(self, number: int, person: _Person) -> None:
        point = person.position_m[:2]
        for zone in self._zones:
            name, distance_m = zone.name, distance_inside(zone.corners_m, point)
            if name not in person.zones:
                if distance_m > 0:
                    count = self._count(name) + 1
                    self._make("entered", number, person, zone=name, count=count)
                    if zone.count is not None and count >= zone.count and name not in self._full:
                        self._make("count_reached", None, person, zone=name, count=count)
            elif distance_m < -self._config.margin_m:
                self._leave(number, person, name)
            elif zone.dwell_s is not None and name not in person.dwelled:
                dwell_s = (person.stamp_ns - person.zones[name]) / 1e9
                if dwell_s > zone.dwell_s:
                    self._make("dwelled", number, person, zone=name, dwell_s=dwell_s)

    def _leave(self, number: int, person: _Person, name: str) -> None:
        dwell_s = max(0.0, (person.stamp_ns - person.zones[name]) / 1e9)
        count = self._count(name) - 1
        self._make("left", number, person, zone=name, dwell_s=dwell_s, count=count)

    def _check_robot(self, number: int, person: _Person, robot_m: F64 | None) -> None:
        if robot_m is None or not self._config.near_m:
            return
        distance_m = math.dist(person.position_m[:2], robot_m[:2])
        if person.is_near:
            person.is_near = distance_m < self._config.near_m + self._config.near_margin_m
        elif distance_m < self._config.near_m:
            self._make("robot_near", number, person, distance_m=distance_m)

    def _check_attention(self, track: Track, person: _Person, robot_m: F64 | None) -> None:
        if robot_m is None:
            return
        to_m = robot_m[:2] - person.position_m[:2]
        distance_m = max(float(np.linalg.norm(to_m)), 1e-3)
        off_rad = math.pi
        if track.yaw_rad is not None and track.state == "confirmed":
            off_rad = abs(wrap(track.yaw_rad - math.atan2(to_m[1], to_m[0])))
        limit_rad = FACING_RAD * (2 if person.facing.is_reported else 1)
        if person.facing.update(off_rad < limit_rad, person.stamp_ns, self._config.faces_s):
            self._make("faces_robot", track.id, person, distance_m=distance_m)
        speed_mps = float(track.velocity_mps[:2] @ to_m) / distance_m
        limit_mps = APPROACH_MPS / (2 if person.approaching.is_reported else 1)
        if person.approaching.update(speed_mps > limit_mps, person.stamp_ns, APPROACH_S):
            self._make("approaches", track.id, person, distance_m=distance_m)

    def _count(self, zone: str) -> int:
        return sum(zone in person.zones for person in self._people.values())


def distance_inside(corners_m: F64, point_m: F64) -> float:
    """Return the distance of a point to the edge of a polygon [m], negative if it is outside.

    Args:
        corners_m: Nx2.
        point_m: x, y.
    """
    a, b = corners_m, np.roll(corners_m, -1, axis=0)
    along, to_point = b - a, point_m - a
    share = np.clip((to_point * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
    distance = float(np.linalg.norm(to_point - share[:, None] * along, axis=1).min())
    crosses = (a[:, 1] > point_m[1]) != (b[:, 1] > point_m[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        at = a[:, 0] + (point_m[1] - a[:, 1]) / along[:, 1] * along[:, 0]
    inside = np.count_nonzero(crosses & (point_m[0] < at)) % 2 == 1
    return distance if inside else -distance


def _same(a: Zone, b: Zone) -> bool:
    return a.name == b.name and np.array_equal(a.corners_m, b.corners_m)
