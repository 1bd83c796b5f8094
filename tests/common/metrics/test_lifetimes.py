"""Lifetimes computed by hand (docs/method.md, section 9). Frames are 0.5 s apart."""

import pytest

from common.metrics.lifetimes import Lifetimes, count_lifetimes
from common.metrics.matching import match
from common.metrics.record import EvaluationSequence
from common.metrics.scores import score
from common.metrics.similarity import GroundDistance
from tests.common.metrics.worlds import sequence, tracked, truth

NEAR = GroundDistance(0.5)
GONE = (truth({"A": 0}, out="A"), tracked({}))


def count(recording: EvaluationSequence) -> Lifetimes:
    return count_lifetimes(match(recording, NEAR))


def test_segments_and_coverage() -> None:
    # Tracks 1, 1, none, 1, 2, 2: two segments, 3 x 0.5 s and 2 x 0.5 s: mean 1.25 s.
    names = (1, 1, None, 1, 2, 2)
    recording = sequence(*(({"A": 0}, {} if i is None else {i: 0}) for i in names))
    lifetimes = count(recording)
    assert lifetimes.segments == 2
    assert lifetimes.mean_segment_s == 1.25
    assert lifetimes.coverage == 5 / 6
    # One switch in 6 x 0.5 s = 3 s: 20 a minute.
    assert lifetimes.duration_s == 3.0
    assert score(recording, NEAR).id_switches_per_min == pytest.approx(20.0)


def test_time_to_first_track() -> None:
    # A is in view from the second frame (0.5 s) and found in the fourth (1.5 s): 1 s. B never is.
    lifetimes = count(
        sequence(
            (truth({"A": 0}, out="A"), {1: 0}),
            ({"A": 0, "B": 9}, {}),
            ({"A": 0, "B": 9}, {}),
            ({"A": 0, "B": 9}, {1: 0}),
        )
    )
    assert lifetimes.mean_first_track_s == 1.0
    assert (lifetimes.people, lifetimes.people_found) == (2, 1)


def test_a_predicted_track_covers_without_being_measured() -> None:
    lifetimes = count(
        sequence(({"A": 0}, {1: 0}), ({"A": 0}, tracked({1: 0}, predicted=(1,))), ({"A": 0}, {}))
    )
    assert (lifetimes.coverage, lifetimes.coverage_measured) == (2 / 3, 1 / 3)


def test_who_need_not_be_found_is_not_covered_either() -> None:
    lifetimes = count(sequence(({"A": 0}, {1: 0}), (truth({"A": 0}, hidden="A"), {1: 0})))
    assert (lifetimes.truths, lifetimes.tracked) == (1, 1)


def test_a_return_under_the_same_track() -> None:
    # Last in view at 0.5 s, back at 2.5 s: 2 s away.
    recording = sequence(*[({"A": 0}, {1: 0})] * 2, *[GONE] * 3, *[({"A": 0}, {1: 0})] * 2)
    lifetimes = count(recording)
    assert (lifetimes.returns, lifetimes.reidentified, lifetimes.share_reidentified) == (1, 1, 1.0)


def test_a_return_under_another_track_or_none() -> None:
    away = [(truth({}), tracked({}))] * 4  # not in the truth at all is away, too
    other = sequence(({"A": 0}, {1: 0}), *away, ({"A": 0}, {2: 0}))
    assert count(other).share_reidentified == 0.0
    never = sequence(({"A": 0}, {1: 0}), *away, ({"A": 0}, {}))
    assert (count(never).returns, count(never).share_reidentified) == (1, 0.0)


def test_the_track_of_most_frames_of_the_visit_counts() -> None:
    # Back under 2 for one frame, then re-identified as 1, with one switch each way.
    recording = sequence(
        ({"A": 0}, {1: 0}), *[GONE] * 4, ({"A": 0}, {2: 0}), *[({"A": 0}, {1: 0})] * 2
    )
    assert count(recording).share_reidentified == 1.0
    assert score(recording, NEAR).clear.id_switches == 2


def test_each_visit_counts_as_a_return_of_its_own() -> None:
    # 1, away, 2, away, 2: the first return fails, the second is re-identified.
    recording = sequence(
        ({"A": 0}, {1: 0}), *[GONE] * 4, ({"A": 0}, {2: 0}), *[GONE] * 4, ({"A": 0}, {2: 0})
    )
    assert (count(recording).returns, count(recording).reidentified) == (2, 1)
    # 1, away, 2, away, 1 for longer: the last visit says nothing about the one before.
    recording = sequence(
        ({"A": 0}, {1: 0}), *[GONE] * 4, ({"A": 0}, {2: 0}), *[GONE] * 4, *[({"A": 0}, {1: 0})] * 3
    )
    assert (count(recording).returns, count(recording).reidentified) == (2, 0)


def test_what_is_no_return() -> None:
    # 1.5 s away is too short; hidden is not away; re-identification requires an earlier track.
    short = sequence(({"A": 0}, {1: 0}), *[GONE] * 2, ({"A": 0}, {2: 0}))
    hidden = sequence(
        ({"A": 0}, {1: 0}), *[(truth({"A": 0}, hidden="A"), {})] * 6, ({"A": 0}, {2: 0})
    )
    unknown = sequence(({"A": 0}, {}), *[GONE] * 6, ({"A": 0}, {2: 0}))
    for recording in (short, hidden, unknown):
        assert count(recording).returns == 0
        assert count(recording).share_reidentified is None
