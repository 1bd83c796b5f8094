"""Hand-over of identities between areas, and conflicts of areas."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from common.runtime.node import LoopCallbacks
from people4d.codec import encode
from people4d.errors import ConfigError, DecodeError
from people4d.messages import AreaPeople, AreaPerson, Detections, Track, Tracks
from services.tracker.areas.config import SiteAreaConfig
from services.tracker.build import build
from services.tracker.config import TrackerConfig
from services.tracker.interface import IdCounter
from services.tracker.node import TrackerNode
from tests.tracker.test_node import TRANSFORM, detected, embeddings_of, person

S = 1_000_000_000
FRAME_NS = 100_000_000
RED, BLUE = [1.0, 0.0], [0.0, 1.0]


def area(name: str, number: int, *neighbours: str, **fields: Any) -> TrackerNode:
    config = SiteAreaConfig(number=number, neighbours=neighbours, **fields)
    node = build(TrackerConfig(area=config))
    node.attach(LoopCallbacks(robot=name))
    node.handle(TRANSFORM, 0)
    return node


class Site:
    """Areas a and b with ten frames a second each; they exchange messages.

    Args:
        fields: Of the configuration of both.
    """

    def __init__(self, **fields: Any) -> None:
        self.nodes = {"a": area("a", 1, "b", **fields), "b": area("b", 2, "a", **fields)}
        self.last: dict[str, Sequence[Track]] = {}
        self.sent: list[AreaPeople] = []

    def see(
        self,
        numbers: range,
        where: str,
        *across_m: float,
        appearance: Sequence[float] = RED,
        stamp_ahead_ns: int = 0,
    ) -> Sequence[Track]:
        """Add people of one appearance to one area, none to the other; return its tracks."""
        for k in numbers:
            now_ns = (k + 10) * FRAME_NS
            for name in self.nodes:
                ahead_ns = stamp_ahead_ns if name == "b" else 0
                people = [person(x) for x in across_m] if name == where else []
                frame = detected(k, people)
                frame = replace(frame, stamp_ns=frame.stamp_ns + ahead_ns)
                self.feed(name, frame, [appearance] * len(people), now_ns)
        return self.last.get(where, ())

    def feed(
        self, sender: str, frame: Detections, appearances: Sequence[Sequence[float]], now_ns: int
    ) -> None:
        """Add a frame to an area, and pass its messages to the other area."""
        node = self.nodes[sender]
        outputs = [
            *node.handle(embeddings_of(frame, appearances), now_ns),
            *node.handle(frame, now_ns),
        ]
        for output in [*outputs, *node.tick(now_ns)]:
            if isinstance(output, Tracks):
                self.last[sender] = output.tracks
            elif isinstance(output, AreaPeople):
                self.sent.append(output)
                for name, node in self.nodes.items():
                    if name != sender:
                        node.handle(output, now_ns)


def ids(tracks: Sequence[Track]) -> list[int]:
    return [track.id for track in tracks]


def walker(identity: int = 1002, **fields: Any) -> AreaPerson:
    """A red person, 3 m before the camera at its middle: see tests.tracker.test_node."""
    defaults: dict[str, Any] = {"position_m": np.array([13.0, 0.0, 1.0]), "unmatched_s": 1.0}
    views = np.array([RED], np.float32)
    return AreaPerson(**{"id": identity, **defaults, "matches": 50, "views": views, **fields})


def message(*people: AreaPerson, **fields: Any) -> AreaPeople:
    defaults = {"stamp_ns": 0, "sequence": 0, "area": "b", "number": 2, "run": 7}
    return AreaPeople(
        **{**defaults, "frame_id": "map", "embedder": "histogram", "people": people, **fields}
    )


def test_person_who_walks_to_the_next_area_has_the_same_identity() -> None:
    site = Site()
    first = site.see(range(20), "a", 0.0)
    # 1 m farther after 1.5 s without a camera: within 0.8 + 2.5 x 1.5 m.
    site.see(range(20, 35), "")
    second = site.see(range(35, 45), "b", 1.0)
    assert ids(first) == ids(second) == [1]
    assert second[0].identity in ("reidentified", "continued")
    site.see(range(45, 60), "")
    back = site.see(range(60, 70), "a", 0.5)
    assert ids(back) == [1]
    assert site.nodes["b"].status().counters["identities_taken_over"] == 1


def test_person_of_another_appearance_gets_an_identity_of_the_area() -> None:
    site = Site()
    site.see(range(20), "a", 0.0)
    site.see(range(20, 35), "")
    assert ids(site.see(range(35, 45), "b", 1.0, appearance=BLUE)) == [2]


def test_person_who_cannot_have_walked_there_gets_an_identity_of_the_area() -> None:
    # 0.2 s after the last match and 3 m off: more than 0.8 + 2.5 x 0.2 m.
    site = Site()
    site.see(range(20), "a", -1.5)
    assert ids(site.see(range(21, 30), "b", 1.5)) == [2]


def test_forgotten_person_gets_an_identity_of_the_area() -> None:
    site = Site(memory_s=1.0)
    site.see(range(20), "a", 0.0)
    site.see(range(20, 40), "")
    assert ids(site.see(range(40, 50), "b", 0.5)) == [2]


def test_identities_of_an_area_are_its_number_and_thousands() -> None:
    counter = IdCounter()
    counter.divide(7)
    assert [counter.new(), counter.new()] == [7, 1007]
    counter.raise_to(5000)  # next identity: the first of area 7 above 5000
    assert counter.new() == 5007
    assert counter.is_own(3007)
    assert not counter.is_own(3008)


def test_person_tracked_by_both_areas_gets_the_older_identity() -> None:
    site = Site()
    site.see(range(20), "a", -1.0)
    # The person in b is first too far away from the person in a, and then meets that person.
    for k in range(20, 60):
        now_ns = (k + 10) * FRAME_NS
        there_m = 1.0 - min(k - 20, 20) * 0.1
        for name, x in (("a", -1.0), ("b", there_m)):
            frame = detected(k, [person(x)])
            site.feed(name, frame, [RED if name == "a" else BLUE], now_ns)
        if k == 41:  # they have just met
            assert ids(site.last["b"]) == [2]
    # Both tracks are one person: 0 m apart for 2 s, with no other person near.
    assert ids(site.last["b"]) == ids(site.last["a"]) == [1]
    assert site.nodes["b"].status().counters["identities_joined"] == 1


def test_people_side_by_side_before_both_areas_are_joined_by_their_appearance() -> None:
    site = Site()
    for k in range(30):
        frame = detected(k, [person(-0.3), person(0.4)])
        for name in ("a", "b"):
            site.feed(name, frame, [RED, BLUE], (k + 10) * FRAME_NS)
    position_m = {track.id: float(track.position_m[1]) for track in site.last["a"]}
    assert len(position_m) == 2
    found_m = {track.id: float(track.position_m[1]) for track in site.last["b"]}
    assert found_m == pytest.approx(position_m, abs=0.05)
    joined = [node.status().counters["identities_joined"] for node in site.nodes.values()]
    assert sum(joined) == 2


def test_identity_tracked_elsewhere_for_longer_is_given_up() -> None:
    node = area("a", 1, "b")
    for k in range(10):
        frame, now_ns = detected(k), (k + 10) * FRAME_NS
        node.handle(embeddings_of(frame, [RED]), now_ns)
        node.handle(frame, now_ns)
    # b has matched identity 1 for 500 frames, 50 m away.
    far = walker(1, position_m=np.array([60.0, 0.0, 1.0]), unmatched_s=0.0, matches=500)
    node.handle(message(far), 20 * FRAME_NS)
    frame = detected(10)
    node.handle(embeddings_of(frame, [RED]), 20 * FRAME_NS)
    (answer,) = (m for m in node.handle(frame, 20 * FRAME_NS) if isinstance(m, Tracks))
    assert ids(answer.tracks) == [1001]
    assert node.status().counters["identities_yielded"] == 1


def test_clocks_apart_do_not_hinder_and_are_reported() -> None:
    site = Site()
    site.see(range(20), "a", 0.0, stamp_ahead_ns=3600 * S)
    site.see(range(20, 35), "", stamp_ahead_ns=3600 * S)
    assert ids(site.see(range(35, 45), "b", 1.0, stamp_ahead_ns=3600 * S)) == [1]
    status = site.nodes["a"].status()
    assert "the clock of area b is 3600." in status.reason
    assert "s ahead of this one's" in status.reason
    assert status.counters["area_clock_apart"] > 0
    assert status.gauges["area_offset_b_ms"] == pytest.approx(3.6e6, abs=500)


def test_silent_neighbour_is_reported() -> None:
    node = area("a", 1, "b", "c")
    node.tick(0)
    node.tick(1)
    node.handle(message(), 2 * S)
    node.tick(4 * S)
    assert (
        node.status().reason
        == "no messages arrive from area c: people from there get new identities"
    )


@pytest.mark.parametrize(
    ("wrong", "reason", "counter"),
    [
        ([{"number": 1}], "area b has number 1, as this one", "area_conflicts"),
        ([{"area": "a", "number": 1}], "another tracker calls itself area a", "area_conflicts"),
        ([{"run": 8}, {"run": 7}], "two trackers serve area b", "area_conflicts"),
        ([{"area": "c"}], "areas b and c have number 2", "area_conflicts"),
        ([{"frame_id": "odom"}], "positions of area b are in odom, not in map", "area_refused"),
        ([{"embedder": "osnet"}], "embeddings of osnet, not of histogram", "area_refused"),
        ([{"people": (walker(), walker())}], "area b names an identity twice", "area_refused"),
    ],
)
def test_impossible_areas_are_refused_and_reported(
    wrong: Sequence[dict[str, Any]], reason: str, counter: str
) -> None:
    node = area("a", 1, "b", "c")
    frame = detected(0, [person(2.0)])
    node.handle(embeddings_of(frame, [BLUE]), FRAME_NS)
    node.handle(frame, FRAME_NS)
    node.handle(message(walker()), FRAME_NS)
    for fields in wrong:
        node.handle(message(**{"people": (walker(),), **fields}), FRAME_NS)
    status = node.status()
    assert reason in status.reason
    assert status.counters[counter] > 0


def take_over(*people: AreaPerson, **fields: Any) -> tuple[list[int], TrackerNode]:
    """Add frames of a red person to area a after messages with people of area b."""
    node = area("a", 1, "b")
    tracks: Sequence[Track] = ()
    for k in range(10):
        now_ns = (k + 1) * FRAME_NS
        node.handle(message(*people, **fields), now_ns)
        frame = detected(k)
        node.handle(embeddings_of(frame, [RED]), now_ns)
        for answer in node.handle(frame, now_ns):
            tracks = answer.tracks if isinstance(answer, Tracks) else tracks
    return ids(tracks), node


def test_person_of_a_message_is_recognised() -> None:
    assert take_over(walker(1002))[0] == [1002]


def test_identity_of_this_area_that_was_never_given_is_refused() -> None:
    found, node = take_over(walker(5001))
    assert found == [1]
    assert node.status().counters["area_refused"] > 0


def test_one_of_two_people_of_one_appearance_is_chosen() -> None:
    assert take_over(walker(1002), walker(2002))[0] == [1002]


@pytest.mark.parametrize(
    "wrong",
    [
        {"views": np.array([[3.0, 0.0]], np.float32)},
        {"views": np.array([[np.nan, 0.0]], np.float32)},
        {"position_m": np.array([np.inf, 0.0, 0.0])},
        {"position_m": np.array([1e9, 0.0, 0.0])},
        {"unmatched_s": -1.0},
        {"matches": 0},
        {"id": 10**13},
    ],
)
def test_absurd_states_of_a_person_are_no_message(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        walker(**wrong)


def test_message_under_the_key_of_another_area_is_refused() -> None:
    node = area("a", 1, "b")
    topic = next(t for t in node.foreign_inputs if "/b/" in t.key)
    assert topic.decode(encode(message())) == message()
    with pytest.raises(DecodeError, match="expected area b, got c"):
        topic.decode(encode(message(area="c")))


def test_views_of_another_length_are_left_out() -> None:
    other = walker(views=np.array([[1.0, 0.0, 0.0]], np.float32))
    assert take_over(other)[0] == [1]


@pytest.mark.parametrize(
    ("config", "name", "reason"),
    [
        ({"area": SiteAreaConfig(number=1, neighbours=("a",))}, "a", "area a is its own neighbour"),
        ({"area": SiteAreaConfig(number=1, neighbours=("b", "b"))}, "a", "each name once"),
        ({"area": SiteAreaConfig(neighbours=("b",))}, "a", "needs tracker.area.number"),
        (
            {"area": SiteAreaConfig(number=1), "tracker": "sort3d"},
            "a",
            "cannot hand identities over",
        ),
    ],
)
def test_impossible_configuration_is_refused(
    config: dict[str, Any], name: str, reason: str
) -> None:
    with pytest.raises(ConfigError, match=reason):
        build(TrackerConfig(**config)).attach(LoopCallbacks(robot=name))


def test_tracker_without_areas_sends_nothing() -> None:
    node = build(TrackerConfig())
    node.attach(LoopCallbacks(robot="robot"))
    assert not node.foreign_inputs
    for k in range(20):
        frame = detected(k)
        assert not any(isinstance(m, AreaPeople) for m in node.handle(frame, k * FRAME_NS))
        assert not any(isinstance(m, AreaPeople) for m in node.tick(k * FRAME_NS))


def test_restarted_tracker_goes_on_in_its_own_identities() -> None:
    site = Site()
    site.see(range(20), "a", 0.0)
    site.see(range(20, 35), "")
    site.see(range(35, 45), "b", 1.0)  # it has identity 1 of area a now
    saved, number = site.nodes["b"].save(), site.nodes["b"].next_number()
    node = build(TrackerConfig(area=SiteAreaConfig(number=2, neighbours=("a",))))
    node.restore(saved, number)
    assert node.next_number() % 1000 == 2
    assert number <= node.next_number() <= number + 1000
