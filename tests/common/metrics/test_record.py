"""What the record of a sequence refuses, and how it tells time."""

import numpy as np
import pytest

from common.metrics import (
    Frame,
    GroundDistance,
    Sequence,
    TrackedPeople,
    TruePeople,
    box_overlap,
    match,
)


def test_an_identity_comes_once_in_a_frame() -> None:
    with pytest.raises(ValueError, match="ids: expected each at most once"):
        TrackedPeople(ids=(1, 2, 1))


def test_columns_have_one_row_each() -> None:
    with pytest.raises(ValueError, match="positions_m: expected shape 2x3, got 1x3"):
        TruePeople(ids=("A", "B"), positions_m=np.zeros((1, 3)))
    with pytest.raises(ValueError, match="predicted: expected shape 1, got 2"):
        TrackedPeople(ids=(1,), predicted=np.zeros(2, np.bool_))
    with pytest.raises(ValueError, match="out_of_view: expected shape 1, got 2"):
        TruePeople(ids=(1,), out_of_view=np.zeros(2, np.bool_))


def test_a_place_is_known_or_absent() -> None:
    with pytest.raises(ValueError, match="boxes_xyxy_px, positions_m: expected finite numbers"):
        TruePeople(ids=("A",), positions_m=np.full((1, 3), np.nan))


def test_stamps_rise() -> None:
    with pytest.raises(ValueError, match="frames of walk: expected rising stamps, got 5 after 5"):
        Sequence("walk", (Frame(stamp_ns=5), Frame(stamp_ns=5)))


def test_each_frame_stands_for_the_time_until_the_next() -> None:
    # Gaps 0.1, 0.1, 0.3 s; the last frame stands for their median: 0.6 s together.
    stamps_ns = (0, 100_000_000, 200_000_000, 500_000_000)
    recording = Sequence("walk", tuple(Frame(stamp_ns=7 + ns) for ns in stamps_ns))
    assert recording.periods_s == pytest.approx([0.1, 0.1, 0.3, 0.1])
    assert Sequence("one", (Frame(stamp_ns=7),)).periods_s.tolist() == [0.0]
    assert Sequence("none", ()).periods_s.tolist() == []


def test_a_similarity_needs_its_column() -> None:
    person = TruePeople(ids=("A",), positions_m=np.zeros((1, 3)))
    with pytest.raises(ValueError, match="boxes_xyxy_px: expected one for each of 1 people, got"):
        box_overlap(person, TrackedPeople())
    with pytest.raises(ValueError, match="positions_m: expected one for each of 1 people, got"):
        GroundDistance(1.0)(person, TrackedPeople(ids=(1,)))
    with pytest.raises(ValueError, match="max_m: expected > 0, got 0"):
        GroundDistance(0)


def test_a_similarity_of_ones_own_is_checked() -> None:
    frame = Frame(stamp_ns=0, truth=TruePeople(ids=("A",)), tracked=TrackedPeople(ids=(1, 2)))
    recording = Sequence("walk", (frame,))
    with pytest.raises(ValueError, match="similarity: expected shape 1x2, got 2x1"):
        match(recording, lambda *_: np.zeros((2, 1)))
    with pytest.raises(ValueError, match="similarity: expected finite numbers"):
        match(recording, lambda *_: np.array([[0.5, np.nan]]))
