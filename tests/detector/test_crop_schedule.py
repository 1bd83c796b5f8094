import numpy as np
import pytest

from people4d.messages import F64, RgbdFrame
from services.detector.crop_schedule import CropSchedule

PERIOD_NS = 50_000_000
SECOND_ALONE = np.array([[0.0], [1.0]])
APART = np.array([[0.0, 0, 40, 100], [60, 0, 100, 100]])
NONE = np.empty((0, 4))


def frame(number: float, camera: str = "front") -> RgbdFrame:
    return RgbdFrame(
        stamp_ns=round(number * PERIOD_NS),
        sequence=round(number),
        camera=camera,
        rgb=np.zeros((2, 2, 3), np.uint8),
        depth_mm=np.zeros((2, 2), np.uint16),
    )


def due_frames(schedule: CropSchedule, boxes: F64, numbers: range) -> list[list[int]]:
    """Return the frames with a crop of each person."""
    due = [schedule.due(frame(n), boxes) for n in numbers]
    return [[n for n, one in zip(numbers, due, strict=True) if one[k]] for k in range(len(boxes))]


@pytest.fixture
def settled() -> CropSchedule:
    """A schedule after two seconds with the same two people."""
    schedule = CropSchedule()
    due_frames(schedule, APART, range(40))
    return schedule


def test_new_people_get_crops_for_half_a_second_and_then_four_times_a_second() -> None:
    expected = [*range(10), 14, 19, 24, 29, 34, 39]
    assert due_frames(CropSchedule(), APART, range(40)) == [expected, expected]


@pytest.mark.parametrize(
    ("boxes", "due"),
    [
        (np.vstack([APART, [[110.0, 0, 150, 100]]]), [False, False, True]),
        (APART[:1], [False]),
        (APART + SECOND_ALONE * (25, 0, 25, 0), [False, True]),  # overlap 15 of 65
        (APART - SECOND_ALONE * (21, 0, 21, 0), [True, True]),
        (np.array([[0.0, 0, 20, 100], [21, 0, 40, 100], APART[1]]), [True, True, False]),
    ],
    ids=["appears", "disappears", "moves far", "overlaps", "splits"],
)
def test_a_change_gives_crops_for_half_a_second(
    settled: CropSchedule, boxes: F64, due: list[bool]
) -> None:
    assert settled.due(frame(40), boxes) == due
    later = due_frames(settled, boxes, range(41, 60))
    assert [47 in frames for frames in later] == due


def test_people_who_overlap_get_crops_in_every_frame() -> None:
    boxes = np.array([[0.0, 0, 40, 100], [30, 0, 70, 100]])
    assert due_frames(CropSchedule(), boxes, range(60)) == [[*range(60)], [*range(60)]]


def test_small_motion_is_no_change(settled: CropSchedule) -> None:
    for k in range(4):
        assert settled.due(frame(40 + k), APART + 3.0 * k) == [False, False]


@pytest.mark.parametrize("number", [46, 3], ids=["gap", "clock went back"])
def test_a_gap_or_an_earlier_clock_is_a_change(settled: CropSchedule, number: int) -> None:
    assert settled.due(frame(number), APART) == [True, True]
    assert settled.due(frame(number + 1), APART) == [True, True]


def test_cameras_are_independent(settled: CropSchedule) -> None:
    assert settled.due(frame(40, "rear"), APART) == [True, True]
    assert settled.due(frame(40), APART) == [False, False]


def test_frames_without_people_need_no_crops(settled: CropSchedule) -> None:
    assert settled.due(frame(40), NONE) == []
    assert settled.due(frame(41), APART) == [True, True]
