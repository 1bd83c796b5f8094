"""The record of a sequence: checks and time."""

import numpy as np
import pytest

from common.metrics.matching import match
from common.metrics.record import EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses
from common.metrics.similarity import GroundDistance, box_overlap


def test_an_identity_comes_once_in_a_frame() -> None:
    with pytest.raises(ValueError, match="ids: expected each at most once"):
        Hypotheses(ids=(1, 2, 1))


def test_columns_have_one_row_each() -> None:
    with pytest.raises(ValueError, match="positions_m: expected shape 2x3, got 1x3"):
        GroundTruth(ids=("A", "B"), positions_m=np.zeros((1, 3)))
    with pytest.raises(ValueError, match="predicted: expected shape 1, got 2"):
        Hypotheses(ids=(1,), predicted=np.zeros(2, np.bool_))
    with pytest.raises(ValueError, match="out_of_view: expected shape 1, got 2"):
        GroundTruth(ids=(1,), out_of_view=np.zeros(2, np.bool_))


def test_a_position_is_known_or_absent() -> None:
    with pytest.raises(ValueError, match="positions_m: expected finite numbers"):
        GroundTruth(ids=("A",), positions_m=np.full((1, 3), np.nan))


def test_stamps_rise() -> None:
    with pytest.raises(ValueError, match="frames of walk: expected rising stamps, got 5 after 5"):
        EvaluationSequence("walk", (EvaluationFrame(stamp_ns=5), EvaluationFrame(stamp_ns=5)))


def test_each_frame_stands_for_the_time_until_the_next() -> None:
    # Gaps 0.1, 0.1, 0.3 s; the last frame stands for their median: 0.6 s together.
    stamps_ns = (0, 100_000_000, 200_000_000, 500_000_000)
    recording = EvaluationSequence(
        "walk", tuple(EvaluationFrame(stamp_ns=7 + ns) for ns in stamps_ns)
    )
    assert recording.periods_s == pytest.approx([0.1, 0.1, 0.3, 0.1])
    assert EvaluationSequence("one", (EvaluationFrame(stamp_ns=7),)).periods_s.tolist() == [0.0]
    assert EvaluationSequence("none", ()).periods_s.tolist() == []


def test_a_similarity_needs_its_column() -> None:
    person = GroundTruth(ids=("A",), positions_m=np.zeros((1, 3)))
    with pytest.raises(ValueError, match="boxes_xyxy_px: expected one for each of 1 people, got"):
        box_overlap(person, Hypotheses())
    with pytest.raises(ValueError, match="positions_m: expected one for each of 1 people, got"):
        GroundDistance(1.0)(person, Hypotheses(ids=(1,)))
    with pytest.raises(ValueError, match="max_m: expected > 0, got 0"):
        GroundDistance(0)


def test_a_similarity_of_ones_own_is_checked() -> None:
    frame = EvaluationFrame(
        stamp_ns=0, truth=GroundTruth(ids=("A",)), hypotheses=Hypotheses(ids=(1, 2))
    )
    recording = EvaluationSequence("walk", (frame,))
    with pytest.raises(ValueError, match="similarity: expected shape 1x2, got 2x1"):
        match(recording, lambda *_: np.zeros((2, 1)))
    with pytest.raises(ValueError, match="similarity: expected finite numbers"):
        match(recording, lambda *_: np.array([[0.5, np.nan]]))
