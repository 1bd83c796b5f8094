"""Results of several detectors are put back in order, within a bounded wait."""

import itertools
from collections.abc import Sequence

import msgspec
import pytest

from people4d.messages import Detections, Message
from services.tracker.node import TrackerNode
from tests.tracker.test_node import FRAME_MS, MS, TRANSFORM, detected, feed, node, numbers, tracks


def by(detector: str, number: int, replicas: str = "ab") -> Detections:
    """An empty frame done by one of several detectors, each named with a letter."""
    return msgspec.structs.replace(
        detected(number, []), detector=detector, replicas=tuple(replicas)
    )


def begun(*detectors: str, **fields: float) -> TrackerNode:
    """A tracker that has had one frame of each detector, 100 ms apart, the last of them 0."""
    target = node(tracker="sort3d", **fields)
    first = 1 - len(detectors)
    messages: list[Message] = [TRANSFORM]
    for number, detector in enumerate(detectors, first + 100):
        messages.append(by(detector, number, "".join(detectors)))
    assert len(feed(target, messages)) == len(detectors)
    return target


def at(number: int) -> int:
    """The number `frames` after the last number of `begun`."""
    return 100 + number


def order(target: TrackerNode, arrivals: Sequence[Detections], now_ns: int = 0) -> list[int]:
    return [number - 100 for number in numbers(feed(target, arrivals, now_ns))]


def test_two_detectors_out_of_order_are_put_in_order() -> None:
    target = begun("a", "b")
    assert order(target, [by("b", at(2))]) == []
    assert order(target, [by("a", at(1))]) == [1, 2]
    assert target.status().counters["missing"] == 0


def test_frames_in_order_do_not_wait() -> None:
    target = begun("a", "b")
    for number, detector in zip(range(1, 9), itertools.cycle("ab"), strict=False):
        assert order(target, [by(detector, at(number))]) == [number]


def test_any_order_within_the_wait_gives_the_same() -> None:
    # Three detectors; each sends its own frames in order: a 1, 4; b 2, 5; c 3, 6.
    arrivals = [by("abc"[k % 3], at(k + 1), "abc") for k in range(6)]
    orders = [
        found
        for found in itertools.permutations(arrivals)
        if all(found.index(arrivals[k]) < found.index(arrivals[k + 3]) for k in range(3))
    ]
    assert len(orders) == 90  # 6! / 2^3
    for found in orders[::3]:
        assert order(begun("a", "b", "c"), found) == [1, 2, 3, 4, 5, 6]


def test_the_wait_is_one_period_of_the_frames_and_what_comes_later_is_counted() -> None:
    target = begun("a", "b")
    assert order(target, [by("b", at(2))], 500 * MS) == []
    assert target.wake_ns() == (500 + FRAME_MS) * MS
    assert tracks(target.tick((499 + FRAME_MS) * MS)) == []
    assert len(tracks(target.tick((500 + FRAME_MS) * MS))) == 1
    assert order(target, [by("a", at(1))], 700 * MS) == []
    counters = target.status().counters
    assert (counters["stale"], counters["missing"]) == (1, 1)


def test_the_wait_can_be_set() -> None:
    target = begun("a", "b", reorder_wait_s=0.02)
    assert order(target, [by("b", at(2))], 500 * MS) == []
    assert target.wake_ns() == 520 * MS


def test_frame_missed_by_the_only_detector_causes_no_wait() -> None:
    target = begun("a")
    assert order(target, [by("a", at(3), "a"), by("a", at(7), "a")]) == [3, 7]
    assert target.status().counters["missing"] == 2 + 3


def test_frame_missed_by_all_replicas_causes_no_wait() -> None:
    # b has sent 4, so 3 waits only for a; when a sends 5, frames 1 to 4 will not arrive.
    target = begun("a", "b")
    assert order(target, [by("b", at(4))]) == []
    assert order(target, [by("a", at(5))]) == [4, 5]


def test_a_detector_that_left_is_not_waited_for() -> None:
    target = begun("a", "b")
    assert order(target, [by("b", at(2), "b")]) == [2]


def test_new_replica_is_waited_for_before_its_first_message() -> None:
    target = begun("a", "b")
    assert order(target, [by("a", at(1), "abc"), by("b", at(3), "abc")]) == [1]
    assert order(target, [by("c", at(2), "abc")]) == [2, 3]


def test_the_frame_of_a_dead_detector_is_waited_for_and_done_by_another() -> None:
    # b did 2 while a lived; a died with frame 1, and b takes it over.
    target = begun("a", "b", reorder_wait_s=4.0)
    assert order(target, [by("b", at(2))]) == []
    assert order(target, [by("b", at(1), "b")], 1000 * MS) == [1, 2]


def test_the_same_frame_from_two_detectors_counts_once() -> None:
    target = begun("a", "b")
    assert order(target, [by("a", at(1)), by("b", at(1))]) == [1]
    assert order(target, [by("b", at(3)), by("a", at(2)), by("a", at(3))]) == [2, 3]
    assert target.status().counters["duplicates"] == 2


@pytest.mark.parametrize("first", [1, 2])
def test_first_frames_wait_for_earlier_ones(first: int) -> None:
    target = node(tracker="sort3d", reorder_wait_s=4.0)
    frames = [by("ab"[k % 2], k) for k in range(3)]
    early = [frames[first], *(f for f in frames if f is not frames[first])]
    assert numbers(feed(target, [TRANSFORM, *early])) == [0, 1, 2]


def test_late_tracker_waits_for_every_replica() -> None:
    target = node(tracker="sort3d")
    assert feed(target, [TRANSFORM, by("a", 500)]) == []
    assert numbers(feed(target, [by("b", 501)])) == [500, 501]


def test_camera_restarted_at_sequence_zero_causes_no_wait() -> None:
    target = begun("a", "b")
    again = msgspec.structs.replace(by("a", at(1)), sequence=0)
    assert order(target, [again]) == [1]
