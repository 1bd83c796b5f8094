"""Interpolated truth, computed by hand."""

import math

import numpy as np
import pytest

from common.metrics.alignment.truth_buffer import TruthBuffer
from people4d.messages import Truth, TruthPerson
from tests import builders

MS = 1_000_000


def person(name: str, x: float, yaw_deg: float | None = None) -> TruthPerson:
    return TruthPerson(
        id=name,
        position_m=np.array([x, 2.0 * x, 1.0]),
        velocity_mps=np.array([x, 0.0, 0.0]),
        yaw_rad=None if yaw_deg is None else math.radians(yaw_deg),
    )


def truth(stamp_ms: int, *people: TruthPerson, frame_id: str = "map") -> Truth:
    return builders.truth(*people, stamp_ns=stamp_ms * MS, frame_id=frame_id)


def buffer(*messages: Truth) -> TruthBuffer:
    made = TruthBuffer()
    for message in messages:
        made.add_truth(message)
    return made


def interpolate(before: Truth, after: Truth, stamp_ns: int) -> Truth:
    buffer = TruthBuffer(max_gap_ns=after.stamp_ns - before.stamp_ns)
    buffer.add_truth(before)
    buffer.add_truth(after)
    found = buffer.at(stamp_ns)
    assert found is not None
    return found


def test_interpolation_at_a_quarter_of_the_gap() -> None:
    (got,) = interpolate(truth(0, person("a", 1.0)), truth(100, person("a", 2.0)), 25 * MS).people
    assert got.position_m.tolist() == [1.25, 2.5, 1.0]
    assert got.velocity_mps is not None
    assert got.velocity_mps.tolist() == [1.25, 0.0, 0.0]
    assert got.yaw_rad is None


@pytest.mark.parametrize(
    ("before_deg", "after_deg", "expected_deg"),
    [
        (170.0, -170.0, 175.0),  # 20 degrees through 180, not 340 back through 0
        (-170.0, 170.0, -175.0),
        (-10.0, 10.0, -5.0),
        (90.0, -150.0, 120.0),  # +120 is shorter than -240
        (179.0, -173.0, -179.0),  # a quarter of 8 degrees: 181 = -179
    ],
)
def test_yaw_is_interpolated_along_the_shorter_arc(
    before_deg: float, after_deg: float, expected_deg: float
) -> None:
    before, after = truth(0, person("a", 0, before_deg)), truth(100, person("a", 0, after_deg))
    (got,) = interpolate(before, after, 25 * MS).people
    assert got.yaw_rad is not None
    assert math.degrees(got.yaw_rad) == pytest.approx(expected_deg)


def test_at_a_sample_truth_is_that_sample() -> None:
    samples = buffer(truth(0, person("a", 1.0, 30)), truth(10, person("a", 3.0, 50)))
    got = samples.at(10 * MS)
    assert got is not None
    assert got.people[0].position_m.tolist() == [3.0, 6.0, 1.0]
    assert math.degrees(got.people[0].yaw_rad or 0) == pytest.approx(50)


def test_a_person_missing_in_one_sample_is_interpolated() -> None:
    # b is detected at 0 and 40 ms: at 15 ms b has gone 15/40 of the way from 1 to 5.
    samples = buffer(
        truth(0, person("a", 0.0), person("b", 1.0)),
        truth(10, person("a", 1.0)),
        truth(20, person("a", 2.0)),
        truth(40, person("a", 4.0), person("b", 5.0)),
    )
    got = samples.at(15 * MS)
    assert got is not None
    assert {p.id: p.position_m[0] for p in got.people} == {"a": 1.5, "b": 2.5}


def test_people_beyond_the_gap_are_absent() -> None:
    samples = buffer(
        truth(0, person("a", 0.0), person("b", 1.0)),
        truth(150, person("a", 1.0)),
        truth(300, person("a", 2.0), person("b", 5.0)),
    )
    got = samples.at(160 * MS)
    assert got is not None
    assert [p.id for p in got.people] == ["a"]  # b was away for 300 ms, more than 200


def test_no_truth_outside_of_the_buffer_or_in_its_gaps() -> None:
    samples = buffer(truth(100, person("a", 0)), truth(200, person("a", 1)), truth(900))
    assert samples.at(99 * MS) is None
    assert samples.at(901 * MS) is None
    assert samples.at(300 * MS) is None
    assert TruthBuffer().at(0) is None


def test_an_empty_sample_has_no_people() -> None:
    got = buffer(truth(0), truth(100)).at(50 * MS)
    assert got is not None
    assert got.people == ()


def test_samples_of_two_frames_are_not_mixed() -> None:
    samples = buffer(truth(0, person("a", 0)), truth(10, person("a", 9), frame_id="mocap"))
    got = samples.at(5 * MS)
    assert got is not None
    assert got.people == ()


def test_a_stamp_that_goes_back_begins_anew() -> None:
    samples = buffer(truth(100, person("a", 0)), truth(200, person("a", 1)), truth(50))
    assert samples.newest_ns == 50 * MS
    assert samples.at(150 * MS) is None


def test_memory_is_bounded() -> None:
    samples = TruthBuffer(capacity=10)
    for stamp_ms in range(100):
        samples.add_truth(truth(stamp_ms, person("a", stamp_ms)))
    assert 10 <= len(samples.messages) < 20
    got = samples.at(95 * MS + MS // 2)
    assert got is not None
    assert got.people[0].position_m[0] == 95.5
