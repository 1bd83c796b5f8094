"""Engagement of people with the robot, by the direction of their chest."""

import math
from dataclasses import dataclass, field

from common.geometry.transforms import wrap
from common.held import HeldCondition
from people4d.messages import F64, Track, Tracks

# Constants of hri_msgs/EngagementLevel
UNKNOWN, DISENGAGED, ENGAGING, ENGAGED, DISENGAGING = range(5)
FACING_RAD = math.radians(25)  # maximum angle between a facing person's yaw and the robot [rad]
HOLD_S = 3.0  # minimum duration of facing or not before the engagement changes [s]
NEAR_M = 4.0  # maximum distance of an engaged person [m]


@dataclass(slots=True)
class _Person:
    """Engagement of one person."""

    facing: HeldCondition = field(default_factory=HeldCondition)
    away: HeldCondition = field(default_factory=HeldCondition)
    is_engaged: bool = False


class Engagement:
    """Levels of engagement of all people of a frame."""

    def __init__(self) -> None:
        self._people: dict[int, _Person] = {}

    def update(self, tracks: Tracks, robot_m: F64 | None) -> dict[int, int]:
        """Return the level of each person; UNKNOWN if yaw or robot are unknown.

        Args:
            tracks: Tracks of a frame.
            robot_m: Position of the robot's base in the frame of the tracks [m]; None if unknown.
        """
        self._people = {one.id: self._people.get(one.id, _Person()) for one in tracks.tracks}
        return {one.id: self._level(one, robot_m, tracks.stamp_ns) for one in tracks.tracks}

    def _level(self, track: Track, robot_m: F64 | None, stamp_ns: int) -> int:
        if robot_m is None or track.yaw_rad is None or track.state == "lost":
            return UNKNOWN
        x_m, y_m = (robot_m[:2] - track.position_m[:2]).tolist()
        is_facing = abs(wrap(track.yaw_rad - math.atan2(y_m, x_m))) <= FACING_RAD
        is_facing &= math.hypot(x_m, y_m) <= NEAR_M
        person = self._people[track.id]
        person.facing.update(is_facing, stamp_ns, HOLD_S)
        person.away.update(not is_facing, stamp_ns, HOLD_S)
        if is_facing:
            person.is_engaged |= person.facing.is_reported
            return ENGAGED if person.is_engaged else ENGAGING
        person.is_engaged &= not person.away.is_reported
        return DISENGAGING if person.is_engaged else DISENGAGED
