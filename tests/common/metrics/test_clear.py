"""CLEAR-MOT worked on paper (docs/method.md, section 9). A match is at most 0.5 m apart."""

import numpy as np
import pytest

from common.metrics.clear import ClearCounts, count_clear
from common.metrics.frame_scores import IdSwitch
from common.metrics.matching import match
from common.metrics.record import EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses
from common.metrics.similarity import GroundDistance, box_overlap
from tests.common.metrics.worlds import sequence, tracked, truth

NEAR = GroundDistance(0.5)


def count(recording: EvaluationSequence) -> ClearCounts:
    return count_clear(match(recording, NEAR))


def test_mota() -> None:
    # Two people in four frames: 8 truths. A is found in all four, by track 3 from the third on
    # (1 switch); B is found in the first only (3 misses); tracks 2 and 9 are at 20 and 30 m with
    # no person (2 false alarms): MOTA = 1 - (3 + 2 + 1) / 8 = 1 - 6/8 = 0.25.
    counts = count(
        sequence(
            ({"A": 0, "B": 10}, {1: 0, 2: 10}),
            ({"A": 0, "B": 10}, {1: 0, 2: 20}),
            ({"A": 0, "B": 10}, {3: 0}),
            ({"A": 0, "B": 10}, {3: 0, 9: 30}),
        )
    )
    assert (counts.misses, counts.false_alarms, counts.id_switches) == (3, 2, 1)
    assert counts.mota == 0.25
    assert counts.recall == 5 / 8
    assert counts.precision == 5 / 7


def test_more_errors_than_people_give_a_negative_mota() -> None:
    # One truth, missed, and two false alarms: 1 - 3/1 = -2.
    assert count(sequence(({"A": 0}, {1: 10, 2: 20}))).mota == -2.0


def test_motp_is_the_mean_similarity() -> None:
    # 0.1 m and 0.3 m apart: 1 - 0.1 / (2 x 0.5) = 0.9 and 0.7, mean 0.8.
    counts = count(sequence(({"A": 0, "B": 10}, {1: 0.1, 2: 10.3})))
    assert counts.motp == pytest.approx(0.8)


def test_a_swap_is_two_switches() -> None:
    recording = sequence(({"A": 0, "B": 10}, {1: 0, 2: 10}), ({"A": 0, "B": 10}, {2: 0, 1: 10}))
    assert count(recording).id_switches == 2
    assert match(recording, NEAR).id_switches == (
        IdSwitch("A", 1, 2, last_frame=0, frame=1),
        IdSwitch("B", 2, 1, last_frame=0, frame=1),
    )


def test_a_switch_counts_after_frames_without_a_track() -> None:
    recording = sequence(({"A": 0}, {1: 0}), ({"A": 0}, {}), ({"A": 0}, {2: 0}), ({"A": 0}, {2: 0}))
    assert match(recording, NEAR).id_switches == (IdSwitch("A", 1, 2, last_frame=0, frame=2),)


def test_out_of_view_is_no_miss() -> None:
    # A is out of view in the second frame and unknown to the truth in the third.
    counts = count(
        sequence(({"A": 0}, {1: 0}), (truth({"A": 0}, out="A"), {}), ({}, {}), ({"A": 0}, {1: 0}))
    )
    assert counts == ClearCounts(frames=4, truths=2, matches=2, outside=1, poses=2, similarity=2.0)


def test_a_pair_persists_though_another_track_is_nearer() -> None:
    # Track 2 at 0.1 m is nearer than track 1 at 0.3 m, but track 1 had A in the previous frame.
    both = ({"A": 0}, {1: 0.3, 2: 0.1})
    assert count(sequence(({"A": 0}, {1: 0}), both)).id_switches == 0
    # Without an earlier pair the nearer track matches; its similarity is 1 - 0.1 / 1.
    assert count(sequence(both)).motp == pytest.approx(0.9)


def test_a_pair_ends_beyond_the_largest_distance() -> None:
    counts = count(sequence(({"A": 0}, {1: 0}), ({"A": 0}, {1: 0.6, 2: 0.1})))
    assert (counts.id_switches, counts.false_alarms) == (1, 1)


def test_a_pair_outlives_an_empty_frame_but_no_other_miss() -> None:
    # As in TrackEval: only a frame with both people and tracks replaces the pairs to keep.
    first, both = ({"A": 0}, {1: 0}), ({"A": 0}, {1: 0.3, 2: 0.1})
    assert count(sequence(first, ({"A": 0}, {}), both)).id_switches == 0
    assert count(sequence(first, ({"A": 0}, {9: 20}), both)).id_switches == 1


def test_two_matches_are_better_than_a_nearer_one() -> None:
    # A-1 alone is 0 m apart, but leaves B (0.4 m) without a track; A-2 and B-1 match both.
    counts = count(sequence(({"A": 0, "B": 0.4}, {1: 0.0, 2: -0.45})))
    assert counts.matches == 2


@pytest.mark.parametrize(("apart_m", "matches"), [(0.5, 1), (0.501, 0)])
def test_the_largest_distance_still_matches(apart_m: float, matches: int) -> None:
    assert count(sequence(({"A": 0}, {1: apart_m}))).matches == matches


def test_height_plays_no_part_in_the_distance() -> None:
    high = Hypotheses(ids=(1,), positions_m=np.array([[0.0, 0.0, 1.8]]))
    assert count(sequence(({"A": 0}, high))).motp == 1.0


def test_boxes_match_from_half_overlap() -> None:
    # 10 x 10 boxes: moved by 3, the overlap is 70 / 130 = 0.54; moved by 4, 60 / 140 = 0.43.
    person = GroundTruth(ids=("A",), boxes_xyxy_px=np.array([[0.0, 0.0, 10.0, 10.0]]))
    for shift, matches in ((3, 1), (4, 0)):
        box = np.array([[0.0, shift, 10.0, 10.0 + shift]])
        frame = EvaluationFrame(
            stamp_ns=0, truth=person, hypotheses=Hypotheses(ids=(1,), boxes_xyxy_px=box)
        )
        assert count_clear(match(EvaluationSequence("x", (frame,)), box_overlap)).matches == matches


def test_who_need_not_be_found_is_neither_miss_nor_match() -> None:
    # C is out of view and has track 3; H is hidden and has none; track 9 is a false alarm.
    people = truth({"A": 0, "C": 5, "H": 8}, out="C", hidden="H")
    counts = count(sequence((people, {1: 0, 3: 5, 9: 20})))
    assert (counts.matches, counts.misses, counts.false_alarms) == (1, 0, 1)


def test_one_track_goes_to_the_person_who_has_to_be_found() -> None:
    # The only track is nearer to H, hidden behind A.
    counts = count(sequence((truth({"A": 0, "H": 0.4}, hidden="H"), {1: 0.3})))
    assert (counts.matches, counts.misses, counts.false_alarms) == (1, 0, 0)


def test_the_track_of_a_person_beside_the_view_is_not_lent_to_another() -> None:
    # B is half outside the image, but measured there; A is in view and missed, then found.
    beside = truth({"A": 0, "B": 0.4}, out="B")
    counts = count(sequence((beside, {2: 0.4}), (beside, {2: 0.4, 1: 0})))
    assert (counts.misses, counts.id_switches, counts.false_alarms) == (1, 0, 0)


def test_the_predicted_track_of_a_hidden_person_is_not_lent_to_another() -> None:
    # H's track 2 continues while H is hidden; A loses its own track: a miss, no switch.
    counts = count(
        sequence(
            ({"A": 0, "H": 0.4}, {1: 0, 2: 0.4}),
            (truth({"A": 0, "H": 0.4}, hidden="H"), tracked({2: 0.4}, predicted=(2,))),
        )
    )
    assert (counts.misses, counts.id_switches, counts.false_alarms) == (1, 0, 0)


def test_a_swap_during_occlusion_counts_after_it() -> None:
    hidden = truth({"A": 0}, hidden="A")
    assert count(sequence(({"A": 0}, {1: 0}), (hidden, {2: 0}), ({"A": 0}, {1: 0}))).mota == 1.0
    assert count(sequence(({"A": 0}, {1: 0}), (hidden, {2: 0}), ({"A": 0}, {2: 0}))).mota == 0.5
