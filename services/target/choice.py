"""The person of a command among the visible people."""

import math
from collections.abc import Iterator

from people4d.messages import F64, TargetCommand
from services.target.observe import TargetCandidate, TargetFrame

# Reason without the pose of the base
NO_BASE = (
    "the nearest person is unknown without the pose of the robot's base: with a fixed camera, set "
    "target.base_frame to map"
)
AT_M = 1.0  # maximum distance of a person from a chosen position [m]


def find_person(command: TargetCommand, frame: TargetFrame) -> tuple[TargetCandidate | None, str]:
    """Return the visible person of a command, or None and the reason."""
    visible = [person for person in frame.people if person.track.detection is not None]
    if command.action == "raised_hand":
        visible = [person for person in visible if person.id in (frame.raised or ())]
        if frame.raised is None:
            return None, "no skeletons arrive, see people4d up --skeletons"
        if len(visible) <= 1:
            return next(iter(visible), None), "no person in view holds up a hand"
    if command.action == "id":
        found = next((person for person in visible if person.id == command.id), None)
        return found, f"person {command.id} is not in view"
    origin_m = command.position_m if command.action == "at" else frame.robot_m
    if origin_m is None:
        return None, NO_BASE
    by_distance = sorted(_distances(visible, origin_m), key=lambda pair: pair[0])
    reach_m = AT_M if command.action == "at" else math.inf
    if by_distance and by_distance[0][0] <= reach_m:
        return by_distance[0][1], ""
    where = f"within {AT_M:g} m of ({origin_m[0]:.1f}, {origin_m[1]:.1f})"
    return None, f"no person is in view{f' {where}' if command.action == 'at' else ''}"


def _distances(
    people: list[TargetCandidate], origin_m: F64
) -> Iterator[tuple[float, TargetCandidate]]:
    return ((math.dist(p.track.position_m[:2], origin_m[:2]), p) for p in people)
