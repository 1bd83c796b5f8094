"""Events of postures and gestures, from skeletons."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from people4d.messages import Event, Message, PersonSkeleton, Skeletons
from people4d.messages.skeleton import Posture
from services.events.build import build
from services.events.config import EventsConfig
from services.events.node import EventsNode
from services.skeleton.body import USUAL_POSE_M
from tests.builders import track, tracks

HEIGHTS_M = {"standing": 1.0, "sitting": 0.6, "bending": 0.8, "lying": 0.2}
Reading = tuple[float, Posture, float]  # time [s], posture, height of the torso [m]


def skeletons(second: float, posture: Posture, height_m: float, **fields: Any) -> Skeletons:
    joints = USUAL_POSE_M.astype(np.float32) + np.array([2.0, 0.0, height_m], np.float32)
    given: dict[str, Any] = {
        "id": 1,
        "state": "confirmed",
        "positions_m": joints,
        "covariances_m2": np.tile(1e-4 * np.eye(3, dtype=np.float32), (17, 1, 1)),
        "measured": (True,) * 17,
        "posture": posture,
        "posture_probability": 0.0 if posture == "unknown" else 0.95,
    }
    person = PersonSkeleton(**{**given, **fields})
    stamp_ns = round(second * 1e9)
    return Skeletons(
        stamp_ns=stamp_ns, sequence=0, frame_id="map", camera="front", people=(person,)
    )


def started(second: float = 0.0) -> EventsNode:
    node = build(EventsConfig(lies_s=3.0))
    node.handle(
        tracks(track(id=1, position_m=np.array([2.0, 0.0, 1.0])), stamp_ns=round(second * 1e9)), 0
    )
    return node


def events(node: EventsNode, readings: Sequence[Reading]) -> list[Event]:
    found = list[Message]()
    for second, posture, height_m in readings:
        found += node.handle(skeletons(second, posture, height_m), 0)
    return [event for event in found if isinstance(event, Event)]


def change(
    to: Posture, moves_s: float, first: Posture = "standing", from_s: float = 0.0
) -> list[Reading]:
    """Return 2 s of a posture, a movement at constant speed, and 5 s of another posture."""
    readings: list[Reading] = []
    for step in range(round((7 + moves_s) * 10)):
        second = step / 10
        part = min(max((second - 2) / moves_s, 0.0), 1.0)
        height_m = HEIGHTS_M[first] + part * (HEIGHTS_M[to] - HEIGHTS_M[first])
        now: Posture = first if part == 0 else to if part == 1 else "unknown"
        readings.append((from_s + second, now, height_m))
    return readings


def kinds(found: Sequence[Event]) -> list[str]:
    return [event.kind for event in found]


def test_fall_is_reported_once_with_its_evidence_and_then_lying() -> None:
    found = events(started(), change("lying", 0.5))
    assert kinds(found) == ["fell", "lies"]
    fell, lies = found
    assert (fell.id, fell.stamp_ns) == (1, 2_500_000_000)
    assert fell.confidence is not None
    assert fell.confidence > 0.8
    assert fell.reason == "down at 1.6 m/s, then lying"
    assert lies.dwell_s == pytest.approx(3.0, abs=0.11)


def test_posture_that_flickers_after_a_fall_is_no_second_fall() -> None:
    readings = [(t, "bending" if 2.7 < t < 2.9 else p, z) for t, p, z in change("lying", 0.5)]
    assert kinds(events(started(), readings)) == ["fell", "lies"]


def test_person_without_a_posture_falls() -> None:
    readings = [
        (second, "unknown" if p == "standing" else p, z) for second, p, z in change("lying", 0.5)
    ]
    assert kinds(events(started(), readings)) == ["fell", "lies"]


def test_person_who_fell_gets_up() -> None:
    found = events(started(), [*change("lying", 0.5), *change("standing", 1.5, "lying", 7.5)])
    assert kinds(found) == ["fell", "lies", "got_up"]


@pytest.mark.parametrize(
    ("to", "moves_s", "expected"),
    [("lying", 2.0, ["lies"]), ("sitting", 0.4, ["sat_down"]), ("bending", 0.4, [])],
)
def test_other_movements_are_no_falls(to: Posture, moves_s: float, expected: list[str]) -> None:
    assert kinds(events(started(), change(to, moves_s))) == expected


def test_person_stands_up() -> None:
    assert kinds(events(started(), change("standing", 1.0, "sitting"))) == ["stood_up"]


@pytest.mark.parametrize("second", [8.0, -1.9])
def test_gap_or_clock_step_during_a_fall_is_no_fall(second: float) -> None:
    node = started()
    events(node, [(2.0 + step / 10, "standing", 1.0) for step in range(10)])
    assert kinds(events(node, [(2.9 + second, "lying", 0.2)])) == []


def test_lost_track_that_goes_down_is_no_fall() -> None:
    """A prediction sinks to the floor as fast as a fall, and says that it lies."""
    node, found = started(), list[Message]()
    for second, posture, height_m in change("lying", 0.5):
        state = "confirmed" if posture == "standing" else "lost"
        found += node.handle(skeletons(second, posture, height_m, state=state), 0)
    assert found == []


def test_person_lower_after_a_short_loss_is_no_fall() -> None:
    """The prediction stays at 1 m for 0.9 s; the person lay down at 0.8 m/s meanwhile."""
    node, found = started(), list[Message]()
    for step in range(30):
        second = 2.0 + step / 10
        is_lost = 5 <= step < 14
        posture: Posture = "standing" if step < 14 else "lying"
        height_m = HEIGHTS_M[posture]
        state = "lost" if is_lost else "confirmed"
        found += node.handle(skeletons(second, posture, height_m, state=state), 0)
    assert found == []


def test_person_without_a_track_has_no_events() -> None:
    node = build(EventsConfig())
    assert events(node, change("lying", 0.5)) == []


def arm(
    move: Callable[[int], tuple[float, float, float]], frames: int = 30, **fields: Any
) -> list[Event]:
    """Return the events of a right wrist that moves relative to its shoulder."""
    node, found = started(), []
    for number in range(frames):
        joints = USUAL_POSE_M.astype(np.float32) + np.array([2.0, 0.0, 1.0], np.float32)
        offset = np.array(move(number), np.float32)
        joints[8], joints[10] = joints[6] + offset / 2, joints[6] + offset
        message = skeletons(number / 10, "standing", 1.0, positions_m=joints, **fields)
        found += [one for one in node.handle(message, 0) if isinstance(one, Event)]
    return found


def test_raised_hand_is_reported_once() -> None:
    assert kinds(arm(lambda _: (0.1, 0.0, 0.5))) == ["raised_hand"]


def test_briefly_raised_hand_is_not_reported() -> None:
    assert arm(lambda number: (0.1, 0.0, 0.5 if number == 9 else -0.5)) == []


def test_waving_hand_is_reported_after_some_swings() -> None:
    found = arm(lambda number: (0.0, 0.2 * np.sin(number * 0.9), 0.45))
    assert kinds(found) == ["raised_hand", "waved"]


def test_raised_hand_that_trembles_does_not_wave() -> None:
    # 0.19 m from side to side; errors of hidden depth move a hand by as much
    assert kinds(arm(lambda number: (0.0, 0.095 * np.sin(number * 0.9), 0.45))) == ["raised_hand"]


def test_pointing_arm_gives_direction_and_point_on_the_floor() -> None:
    (found,) = arm(lambda _: (0.5, 0.0, -0.25))
    assert found.kind == "pointed"
    assert found.direction is not None
    assert found.direction == pytest.approx(np.array([0.894, 0.0, -0.447]), abs=1e-3)
    assert found.target_m is not None
    assert found.target_m == pytest.approx([2.0 + 2 * 1.25, -0.17, 0.0], abs=0.01)


@pytest.mark.parametrize(("hidden", "expected"), [(6, ["pointed"]), (8, ["pointed"]), (10, [])])
def test_pointing_arm_needs_only_its_wrist(hidden: int, expected: list[str]) -> None:
    measured = tuple(joint != hidden for joint in range(17))
    assert kinds(arm(lambda _: (0.5, 0.0, -0.25), measured=measured)) == expected


@pytest.mark.parametrize("offset", [(0.0, 0.0, -0.55), (0.5, 0.0, 0.2)])
def test_hanging_arm_and_arm_above_the_horizon_have_no_floor(
    offset: tuple[float, float, float],
) -> None:
    assert all(event.target_m is None for event in arm(lambda _: offset))
