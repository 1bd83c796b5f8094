"""Rules of events: each event once, also over restarts."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from people4d.messages import Event, Zone
from services.events.config import EventsConfig
from services.events.rules import NEW_MAX, EventRules, distance_inside
from tests.builders import track, tracks

SQUARE = Zone(name="door", corners_m=np.array([[0.0, 0], [2, 0], [2, 2], [0, 2]]))
SECOND_NS = 10**9


def rules_of(*zones: Zone, earlier: Sequence[Event] = (), **settings: Any) -> EventRules:
    rules = EventRules(EventsConfig(**settings))
    rules.change_zones(zones)
    for event in earlier:
        rules.apply(event)
    return rules


def at(second: float, *people: tuple[int, float, float], **fields: Any) -> Any:
    """Build the tracks at a time: id, x, y of each person."""
    found = (
        track(id=number, position_m=np.array([x, y, 1.0]), **fields) for number, x, y in people
    )
    return tracks(*found, stamp_ns=round(second * SECOND_NS))


def kinds(events: Sequence[Event]) -> list[tuple[str, int | None]]:
    return [(event.kind, event.id) for event in events]


def test_person_appears_and_disappears_once() -> None:
    rules = rules_of()
    found = [
        *rules.update(at(0, (1, 5, 5)), None),
        *rules.update(at(0.5, (1, 5, 5)), None),
        *rules.update(at(1.4), None),
        *rules.update(at(1.6), None),
        *rules.update(at(9.0), None),
    ]
    assert kinds(found) == [("appeared", 1), ("disappeared", 1)]
    assert [event.sequence for event in found] == [0, 1]


def test_person_who_disappeared_returns() -> None:
    rules = rules_of()
    rules.update(at(0, (1, 5, 5)), None)
    rules.update(at(5), None)
    assert kinds(rules.update(at(6, (1, 5, 5)), None)) == [("returned", 1)]


def test_lost_and_tentative_people_do_not_appear() -> None:
    rules = rules_of()
    assert rules.update(at(0, (1, 5, 5), state="lost"), None) == []
    assert rules.update(at(0, (1, 5, 5), state="tentative"), None) == []


def test_zone_is_entered_and_left_beyond_its_margin() -> None:
    rules = rules_of(SQUARE, margin_m=0.2)
    rules.update(at(0, (1, -1, 1)), None)
    entered = rules.update(at(1, (1, 0.1, 1)), None)
    at_the_edge = rules.update(at(2, (1, -0.1, 1)), None)
    left = rules.update(at(4, (1, -0.3, 1)), None)
    assert kinds(entered) == [("entered", 1)]
    assert entered[0].count == 1
    assert at_the_edge == []
    assert kinds(left) == [("left", 1)]
    assert (left[0].dwell_s, left[0].count, left[0].zone) == (3.0, 0, "door")


def test_long_stay_is_one_event() -> None:
    zone = Zone(name="door", corners_m=SQUARE.corners_m, dwell_s=2.0)
    rules = rules_of(zone)
    found = [e for s in range(6) for e in rules.update(at(s, (1, 1, 1)), None)]
    assert kinds(found) == [("appeared", 1), ("entered", 1), ("dwelled", 1)]
    assert found[-1].dwell_s == 3.0


def test_count_is_reached_again_after_a_person_left() -> None:
    zone = Zone(name="door", corners_m=SQUARE.corners_m, count=2)
    rules = rules_of(zone)
    first = rules.update(at(0, (1, 1, 1), (2, 1, 0.5)), None)
    rules.update(at(0.5, (1, 1, 1), (2, 5, 5)), None)
    second = rules.update(at(1, (1, 1, 1), (2, 1, 0.5)), None)
    assert kinds(first)[-1] == kinds(second)[-1] == ("count_reached", None)
    assert first[-1].count == 2


def test_person_near_the_robot_is_one_event_until_they_go_away() -> None:
    rules, robot = rules_of(near_m=1.0, near_margin_m=0.5), np.zeros(3)
    distances = (3.0, 0.9, 1.2, 0.8, 1.6, 0.7)
    found = [e for s, x in enumerate(distances) for e in rules.update(at(s, (1, x, 0)), robot)]
    near = [e for e in found if e.kind == "robot_near"]
    assert [event.distance_m for event in near] == [0.9, 0.7]


def test_uncertain_identity_is_one_event_until_it_is_certain() -> None:
    rules = rules_of()
    confidences = (0.9, 0.4, 0.3, 0.6, 0.4, 0.8, 0.2)
    found = [
        e
        for s, c in enumerate(confidences)
        for e in rules.update(at(s, (1, 5, 5), identity_confidence=c), None)
    ]
    doubtful = [e.confidence for e in found if e.kind == "identity_uncertain"]
    assert doubtful == [0.4, 0.2]


@pytest.mark.parametrize("cut", range(9))
def test_restart_at_any_time_makes_each_event_once(cut: int) -> None:
    zone = Zone(name="door", corners_m=SQUARE.corners_m, dwell_s=1.5, count=2)
    path = [
        at(0, (1, -1, 1)),
        at(1, (1, 1, 1)),
        at(2, (1, 1, 1), (2, 1, 0.5)),
        at(3, (1, 1, 1), (2, 1, 0.5)),
        at(4, (1, 5, 5), (2, 1, 0.5)),
        at(5, (2, 1, 0.5)),
        at(6.5, (2, 1, 0.5)),
        at(8),
    ]
    rules, robot = rules_of(zone), np.array([5.0, 5.5, 0])
    expected = [event for message in path for event in rules.update(message, robot)]
    before = rules_of(zone)
    found = [event for message in path[:cut] for event in before.update(message, robot)]
    after = rules_of(zone, earlier=found)
    found += [event for message in path[cut:] for event in after.update(message, robot)]
    assert kinds(found) == kinds(expected)
    assert [event.sequence for event in found] == list(range(len(expected)))


def test_all_people_disappear_when_a_run_ends() -> None:
    rules = rules_of(SQUARE)
    rules.update(at(0, (1, 1, 1), (2, 5, 5)), None)
    assert kinds(rules.close()) == [("left", 1), ("disappeared", 1), ("disappeared", 2)]
    assert rules.close() == []


def test_zone_that_is_deleted_is_not_left() -> None:
    rules = rules_of(SQUARE)
    rules.update(at(0, (1, 1, 1)), None)
    rules.change_zones(())
    assert rules.update(at(1, (1, 5, 5)), None) == []


def test_distance_to_the_edge_of_a_zone() -> None:
    # An L of three squares of 1 m; its inner corner is (1, 1).
    corners = np.array([[0.0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]])
    assert distance_inside(corners, np.array([0.5, 0.25])) == pytest.approx(0.25)
    assert distance_inside(corners, np.array([1.5, 1.5])) == pytest.approx(-0.5)
    assert distance_inside(corners, np.array([3.0, 0.5])) == pytest.approx(-1.0)


def test_invented_people_make_a_bounded_number_of_events_and_are_counted() -> None:
    rules = rules_of()
    made = rules.update(at(0, (1, 5, 5)), None)
    for second in range(1, 21):
        invented = [(1000 * second + number, 5.0, 5.0) for number in range(1000)]
        made += rules.update(at(2 * second, (1, 5, 5), *invented), None)
    appeared = [event for event in made if event.kind != "disappeared"]
    assert NEW_MAX <= len(appeared) < 2 * NEW_MAX  # of 20,000
    assert rules.left_out > 15_000
    assert not [event for event in made if event.id == 1 and event.sequence]


def test_person_who_faces_the_robot_for_long_is_reported_once() -> None:
    rules, robot_m, found = rules_of(faces_s=2.0), np.zeros(3), []
    for step in range(50):
        yaw_rad = np.pi if step < 40 else 0.0
        found += rules.update(at(step / 10, (1, 3, 0), yaw_rad=yaw_rad), robot_m)
    assert kinds(found) == [("appeared", 1), ("faces_robot", 1)]
    assert (found[1].stamp_ns, found[1].distance_m) == (2 * SECOND_NS, 3.0)


@pytest.mark.parametrize("fields", [{"yaw_rad": None}, {"yaw_rad": np.pi, "state": "lost"}])
def test_unknown_yaw_and_lost_people_do_not_face_the_robot(fields: Any) -> None:
    rules, found = rules_of(faces_s=1.0), []
    rules.update(at(0, (1, 3, 0), yaw_rad=None), np.zeros(3))
    for step in range(1, 30):
        found += rules.update(at(step / 10, (1, 3, 0), **fields), np.zeros(3))
    assert found == []


@pytest.mark.parametrize(("speed_mps", "expected"), [(-0.8, ["approaches"]), (0.8, [])])
def test_person_who_walks_towards_the_robot_approaches(
    speed_mps: float, expected: list[str]
) -> None:
    rules, found = rules_of(near_m=0.0), []
    for step in range(30):
        velocity = {"velocity_mps": np.array([speed_mps, 0.0, 0.0]), "yaw_rad": None}
        found += rules.update(at(step / 10, (1, 4, 0), **velocity), np.zeros(3))
    assert [kind for kind, _ in kinds(found)] == ["appeared", *expected]
