"""Events around people, and the zones that cause some of them."""

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from people4d.messages.base import (
    F64,
    MAX_M,
    MAX_STAMP_NS,
    Count,
    Message,
    Name,
    NonNegative,
    Positive,
    PositiveInt,
    Record,
    Text,
    Vector3,
)
from people4d.validation import Magnitude, Shape

ZONES_MAX = 64
CORNERS_MAX = 64
PEOPLE_MAX = 1000  # upper limit of Zone.count
AREA_MIN_M2 = 1e-4

ZoneName = Annotated[Text, Meta(min_length=1, max_length=64)]


class Zone(Record, frozen=True, kw_only=True):
    """A polygon on the ground that people enter and leave."""

    name: ZoneName  # display name, unique among the zones
    # [m] x, y of the corners in order, frame: frame of Tracks; the polygon is closed
    corners_m: Annotated[F64, Shape("N", 2), Magnitude(MAX_M)]
    # [s] duration of a stay that is an event; absent: no such event
    dwell_s: Positive | None = None
    # number of people in the zone that causes an event; absent: no such event
    count: Annotated[int, Meta(ge=1, le=PEOPLE_MAX)] | None = None

    def __post_init__(self) -> None:
        """Check the fields, and that the polygon has an area and does not cross itself."""
        super().__post_init__()
        number = len(self.corners_m)
        if not 3 <= number <= CORNERS_MAX:
            raise ValueError(
                f"corners_m: expected 3 to {CORNERS_MAX} corners of {self.name!r}, got {number}"
            )
        crossing = _crossing(self.corners_m)
        if crossing:
            first, second = crossing
            raise ValueError(
                f"corners_m: the edge from corner {first + 1} of {self.name!r} crosses the one "
                f"from corner {second + 1}, expected a polygon that does not cross itself"
            )
        x, y = self.corners_m.T
        if abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2 < AREA_MIN_M2:
            raise ValueError(f"corners_m: expected {self.name!r} to have an area, got none")


class Zones(Message, frozen=True, kw_only=True):
    """The zones in force, sent whenever they change; its sequence counts the changes."""

    zones: Annotated[tuple[Zone, ...], Meta(max_length=ZONES_MAX)] = ()  # each name once
    problem: Text = ""  # reason why the last edit was refused; empty if it was accepted

    def __post_init__(self) -> None:
        """Check the fields, and that names are unique."""
        super().__post_init__()
        _check_names(self.zones)


class ZoneEdit(Message, frozen=True, kw_only=True):
    """Request to replace the zones."""

    base: Count  # sequence of the edited Zones; an outdated edit is refused
    zones: Annotated[tuple[Zone, ...], Meta(max_length=ZONES_MAX)] = ()  # all zones

    def __post_init__(self) -> None:
        """Check the fields, and that names are unique."""
        super().__post_init__()
        _check_names(self.zones)


class Event(Message, frozen=True, kw_only=True):
    """One event, sent once; its sequence is unique and continues after a restart of the service.

    Its stamp is the stamp of its Tracks.
    """

    # appeared, returned (under an earlier identity), disappeared: of tracks; identity_uncertain:
    # see confidence; entered, left, dwelled, count_reached: of a zone; robot_near: a person comes
    # closer to the robot than configured; faces_robot: for longer than configured; approaches: for
    # a second; with skeletons: fell, got_up, sat_down, stood_up, lies (longer than configured),
    # raised_hand, waved, pointed (see direction)
    kind: Literal[
        "appeared",
        "returned",
        "disappeared",
        "identity_uncertain",
        "entered",
        "left",
        "dwelled",
        "count_reached",
        "robot_near",
        "faces_robot",
        "approaches",
        "fell",
        "got_up",
        "sat_down",
        "stood_up",
        "lies",
        "raised_hand",
        "waved",
        "pointed",
    ]
    id: PositiveInt | None = None  # identity as in Tracks; absent in count_reached
    zone: Text = ""  # name of the zone; empty if none
    position_m: Vector3 | None = None  # [m] last position of the person, frame: frame_id
    frame_id: Name = "map"  # frame of position_m
    # [s] duration of the stay, in left and dwelled; of lying, in lies
    dwell_s: NonNegative | None = None
    count: Count | None = None  # people in the zone after the event; absent without a zone
    distance_m: NonNegative | None = None  # [m] to the robot on the ground
    # confidence of the identity, in identity_uncertain; probability of a posture or a raised hand
    confidence: NonNegative | None = None
    direction: Vector3 | None = None  # unit vector of the arm in pointed, frame: frame_id
    # [m] meeting of the arm's line with the floor within 10 m, in pointed, frame: frame_id
    target_m: Vector3 | None = None
    # reason of the identity, in identity_uncertain and returned; of a fall; empty if unknown
    reason: Text = ""
    # [ns] wall clock of the stamp, for a recording the time of its playback; absent if unknown
    wall_ns: Annotated[int, Meta(ge=0, le=MAX_STAMP_NS)] | None = None


def _check_names(zones: tuple[Zone, ...]) -> None:
    names = [zone.name for zone in zones]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"zones: expected each name once, got {twice!r} twice")


def _crossing(corners_m: F64) -> tuple[int, int] | None:
    """Return the numbers of two edges that cross or touch, None if there are none.

    Consecutive edges may share only their corner.
    """
    number = len(corners_m)
    points = corners_m.tolist()
    edges = [(points[k], points[(k + 1) % number]) for k in range(number)]
    for i in range(number):
        if edges[i][0] == edges[i][1]:
            return i, (i + 1) % number
        for j in range(i + 1, number):
            if j == i + 1 or (i == 0 and j == number - 1):
                before, after = (edges[i], edges[j]) if j == i + 1 else (edges[j], edges[i])
                if _folds_back(before[0], before[1], after[1]):
                    return i, j
            elif _meet(*edges[i], *edges[j]):
                return i, j
    return None


def _side(a: list[float], b: list[float], c: list[float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _folds_back(a: list[float], b: list[float], c: list[float]) -> bool:
    ahead = (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1])
    return _side(a, b, c) == 0 and ahead < 0


def _meet(a: list[float], b: list[float], c: list[float], d: list[float]) -> bool:
    """Check that the segments ab and cd have a point in common."""
    sides = _side(a, b, c), _side(a, b, d), _side(c, d, a), _side(c, d, b)
    if sides[0] * sides[1] < 0 and sides[2] * sides[3] < 0:
        return True
    ends = ((a, b, c), (a, b, d), (c, d, a), (c, d, b))
    return any(side == 0 and _between(p, q, r) for side, (p, q, r) in zip(sides, ends, strict=True))


def _between(a: list[float], b: list[float], c: list[float]) -> bool:
    """Check that c, on the line ab, lies between a and b."""
    return all(min(p, q) <= r <= max(p, q) for p, q, r in zip(a, b, c, strict=True))
