"""The cascade on a person of one colour before a wall, and on invalid input."""

from collections.abc import Sequence

import numpy as np
import pytest

from people4d.messages import F64, U8, U16
from services.gait.cascade import Cascade, GaitEstimate, PersonObservation
from services.gait.config import CascadeConfig, DepthLayerConfig
from services.gait.points.keypoints import ANKLES, POINTS
from tests.gait.builders import INFO

DEPTH_M = 2.5
PERIOD_NS = 33_000_000
BOX = np.array([270.0, 70.0, 370.0, 440.0])
PARTS = (  # rows and columns of head, torso, arms and legs
    (slice(80, 130), slice(300, 340)),
    (slice(130, 280), slice(280, 360)),
    (slice(280, 430), slice(280, 312)),
    (slice(280, 430), slice(328, 360)),
)


def images(shift_px: int = 0) -> tuple[U8, U16]:
    rgb = np.full((480, 640, 3), (120, 130, 140), np.uint8)
    depth_mm = np.full((480, 640), 4000, np.uint16)
    for rows, columns in PARTS:
        moved = slice(columns.start + shift_px, columns.stop + shift_px)
        rgb[rows, moved] = (200, 40, 40)
        depth_mm[rows, moved] = round(DEPTH_M * 1000)
    return rgb, depth_mm


def observation(person: int = 1, box: F64 | None = BOX) -> PersonObservation:
    return PersonObservation(person, box, None, DEPTH_M)


def play(
    cascade: Cascade, frames: int, people: Sequence[PersonObservation]
) -> list[list[GaitEstimate]]:
    rgb, depth_mm = images()
    return [cascade.update_people(n * PERIOD_NS, rgb, depth_mm, people) for n in range(frames)]


def states(estimate: GaitEstimate) -> set[str]:
    return {point.state for point in estimate.points.values()}


def test_points_that_start_without_a_detection_are_predicted() -> None:
    # Ankles off the body start no points; the next frame has no keypoints but ends of limbs.
    cascade, (rgb, depth_mm) = Cascade(CascadeConfig(), INFO), images()
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[ANKLES, 2] = 0.9
    detected = PersonObservation(1, BOX, keypoints, DEPTH_M)
    cascade.update_people(0, rgb, depth_mm, [detected])
    (found,) = cascade.update_people(PERIOD_NS, rgb, depth_mm, [observation()])
    assert "predicted" in states(found)
    assert "measured" not in states(found)


def test_points_are_measured_without_keypoints_if_the_ankles_are_uncertain() -> None:
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[ANKLES, 2] = 0.4
    detected = PersonObservation(1, BOX, keypoints, DEPTH_M)
    (found,) = play(Cascade(CascadeConfig(), INFO), 8, [detected])[-1]
    (alone,) = play(Cascade(CascadeConfig(), INFO), 8, [observation()])[-1]
    assert "measured" in states(found)
    for name, point in alone.points.items():
        np.testing.assert_array_equal(found.points[name].position_m, point.position_m)


def test_points_lie_on_the_body() -> None:
    # The torso's middle is at column 320, the crown at row 80, the soles at row 430; f = 500 px.
    (estimate,) = play(Cascade(CascadeConfig(), INFO), 8, [observation()])[-1]
    head = estimate.points["head"]
    assert head.state == "measured"
    assert head.position_m[0] == pytest.approx(0.0, abs=0.15)
    assert head.position_m[1] == pytest.approx((105 - 240) / 500 * DEPTH_M, abs=0.15)
    for name in POINTS:
        if name in estimate.points and estimate.points[name].state == "measured":
            assert estimate.points[name].position_m[2] == pytest.approx(DEPTH_M, abs=0.1)


@pytest.mark.parametrize("feature", ["spin", "geodesic", "combined"])
def test_same_seed_gives_same_points_with_every_feature(feature: str) -> None:
    config = CascadeConfig(depth=DepthLayerConfig(feature=feature))  # type: ignore[arg-type]
    first, second = (play(Cascade(config, INFO), 5, [observation()])[-1][0] for _ in range(2))
    assert first.points.keys() == second.points.keys()
    for name, point in first.points.items():
        np.testing.assert_array_equal(point.position_m, second.points[name].position_m)


@pytest.mark.parametrize(
    "box",
    [
        np.array([300.0, 100.0, 300.0, 100.0]),  # empty
        np.array([340.0, 100.0, 300.0, 90.0]),  # inside out
        np.array([900.0, 900.0, 990.0, 990.0]),  # outside of the image
        np.array([320.0, 200.0, 321.0, 201.0]),  # a person of one pixel
        np.array([np.nan, 0.0, 10.0, 10.0]),
        np.array([0.0, 0.0, np.inf, 10.0]),
        None,
    ],
)
def test_invalid_box_measures_no_point(box: F64 | None) -> None:
    for estimate in play(Cascade(CascadeConfig(), INFO), 3, [observation(box=box)]):
        assert "measured" not in states(estimate[0])


def test_without_depth_no_point_is_measured() -> None:
    cascade = Cascade(CascadeConfig(), INFO)
    play(cascade, 5, [observation()])
    rgb, depth_mm = images()
    for number in range(5, 60):
        (estimate,) = cascade.update_people(number * PERIOD_NS, rgb, 0 * depth_mm, [observation()])
        assert "measured" not in states(estimate)
    # Nearly two seconds later points are lost.
    assert states(estimate) <= {"lost"}


@pytest.mark.slow
def test_deleted_person_is_tracked_again() -> None:
    cascade = Cascade(CascadeConfig(), INFO)
    play(cascade, 5, [observation()])
    rgb, depth_mm = images()
    for number in range(5, 100):
        assert cascade.update_people(number * PERIOD_NS, rgb, depth_mm, []) == []
    assert cascade.people == ()  # deleted after two seconds
    for number in range(100, 108):
        (estimate,) = cascade.update_people(number * PERIOD_NS, rgb, depth_mm, [observation()])
    assert estimate.points["head"].state == "measured"


def test_colour_layer_tracks_the_box_without_detection() -> None:
    cascade = Cascade(CascadeConfig(), INFO)
    play(cascade, 5, [observation()])
    for number in range(5, 10):
        rgb, depth_mm = images(3 * (number - 4))
        (estimate,) = cascade.update_people(
            number * PERIOD_NS, rgb, depth_mm, [observation(box=None)]
        )
    assert estimate.box_xyxy_px is not None
    # In five frames of 3 px the person went 15 px to the right.
    middle = float(estimate.box_xyxy_px[[0, 2]].mean())
    assert middle == pytest.approx(320 + 15, abs=12)


def test_earlier_stamp_resets_the_cascade() -> None:
    cascade = Cascade(CascadeConfig(), INFO)
    play(cascade, 3, [observation(1)])
    rgb, depth_mm = images()
    cascade.update_people(0, rgb, depth_mm, [observation(2)])
    assert cascade.people == (2,)


def test_legs_cut_off_by_the_image_have_no_feet() -> None:
    # Knees at the lowest rows, 110 rows lower than in `images`.
    rgb, depth_mm = images()
    rgb = np.roll(rgb, 110, axis=0)
    depth_mm = np.roll(depth_mm, 110, axis=0)
    rgb[:110], depth_mm[:110] = (120, 130, 140), 4000
    cascade, box = Cascade(CascadeConfig(), INFO), BOX + np.array([0, 110, 0, 110])
    for number in range(8):
        (estimate,) = cascade.update_people(
            number * PERIOD_NS, rgb, depth_mm, [observation(box=box)]
        )
    assert estimate.points["head"].state == "measured"
    assert {estimate.points[name].state for name in ("left_foot", "right_foot")} == {"lost"}
