"""The correction of camera turns, worked by hand: its sign, its size, its effect."""

import math

import numpy as np
import pytest

from common.geometry.transforms import project, rotation_from_rpy
from people4d.messages import F64
from services.tracker.config import ImageSortConfig
from services.tracker.image_sort.box_kalman import TRACK, begin
from services.tracker.image_sort.camera_turn import (
    CameraDirection,
    Lens,
    Turn,
    turn_between,
    turn_tracks,
)
from services.tracker.image_sort.image_sort import BoxFrame, ImageSort
from tests import builders

FRAME_NS = 50_000_000


def begun(u: float, v: float, width: float = 40.0, height: float = 100.0) -> np.void:
    track: np.void = np.zeros(1, TRACK)[0]
    begin(track, np.array([u - width / 2, v - height / 2, u + width / 2, v + height / 2]))
    return track


def test_turning_left_moves_the_image_right_by_the_angle_over_the_field_of_view() -> None:
    # 640 px see 60 degrees: 3 degrees to the left move all by 640 * 3 / 60 = 32 px to the right.
    lens = Lens(640 / math.radians(60), 0.0, 320.0, 240.0)
    for u in (100.0, 320.0, 600.0):
        track = begun(u, 240)
        turn_tracks(track, Turn(math.radians(3)), lens)
        assert list(track["x"]) == pytest.approx([u + 32, 240, 4000, 0.4])
        turn_tracks(track, Turn(math.radians(-3)), lens)
        assert track["x"][0] == pytest.approx(u)


def test_uncertain_turn_adds_variance_to_the_position() -> None:
    # 1 degree is 640 / 60 px; its square is added to the variance of 10 px^2.
    track = begun(320, 240)
    turn_tracks(track, Turn(0.0, math.radians(1)), Lens(640 / math.radians(60), 0.0, 320.0, 240.0))
    assert track["pp"][0] == pytest.approx(10 + (640 / 60) ** 2)


def test_turning_up_moves_the_image_down() -> None:
    # As sideways: 3 degrees move all by 640 * 3 / 60 = 32 px.
    track = begun(100, 240)
    lens = Lens(640 / math.radians(60), 0.0, 320.0, 240.0)
    turn_tracks(track, Turn(0.0, up_rad=math.radians(3)), lens)
    assert list(track["x"]) == pytest.approx([100, 272, 4000, 0.4])


def detected(points_m: F64, turned_rad: float, up_rad: float = 0.0) -> F64:
    """Return the pixels of points by a pinhole camera that has turned to the left, or up."""
    info = builders.camera_info(camera="c", frame_id="o", fx=400.0)
    link = points_m @ rotation_from_rpy(0, -up_rad, turned_rad)  # the inverse of the turn
    return project(np.column_stack([-link[:, 1], -link[:, 2], link[:, 0]]), info)


PINHOLE = Lens(0.0, 400.0, 320.0, 240.0)
ANGLE_RAD = math.radians(5)


@pytest.mark.parametrize("turn", [Turn(ANGLE_RAD), Turn(0.0, up_rad=ANGLE_RAD)])
def test_pinhole_points_move_by_their_position(turn: Turn) -> None:
    points = np.array([[4.0, y, z] for y in (-2.0, 0.0, 1.5) for z in (-1.0, 0.0, 1.0)])
    turned = detected(points, turn.rad, turn.up_rad)
    for before, after in zip(detected(points, 0.0), turned, strict=True):
        track = begun(*before)
        turn_tracks(track, turn, PINHOLE)
        np.testing.assert_allclose(track["x"][:2], after, atol=1e-9)


@pytest.mark.parametrize("up", [True, False])
def test_pinhole_boxes_grow_towards_the_rim(up: bool) -> None:
    # A small square at 20 degrees from the axis, then at 30: along the turn its side grows by the
    # square of cos 20 / cos 30, across by that.
    rim = 400 * math.tan(math.radians(20))
    track = begun(320, 240 + rim, 2, 2) if up else begun(320 + rim, 240, 2, 2)
    angle_rad = math.radians(10)
    turn_tracks(track, Turn(0.0, up_rad=angle_rad) if up else Turn(angle_rad), PINHOLE)
    grown = math.cos(math.radians(20)) / math.cos(math.radians(30))
    assert track["x"][2] == pytest.approx(4 * grown**3)
    assert track["x"][3] == pytest.approx(1 / grown if up else grown)


def test_point_turned_behind_the_camera_stays_finite() -> None:
    track = begun(600, 240)
    turn_tracks(track, Turn(3.0), Lens(0.0, 400.0, 320.0, 240.0))
    assert np.isfinite(track["x"]).all()


def test_the_velocity_holds_only_the_persons_own_motion() -> None:
    # A steady turn of 12 px a frame; after ten frames a prediction without a turn stays in place.
    config = ImageSortConfig(min_hits=0, ego_motion="odometry")
    turn = Turn(math.radians(64 * 12 / 640))
    tracker = ImageSort(config)
    for number in range(10):
        box = np.array([[100.0 + 12 * number, 100, 140 + 12 * number, 200]])
        tracks = tracker.update(
            BoxFrame(number * FRAME_NS, box, np.ones(1), (640, 480), turn, 64.0)
        )
    assert tracks.boxes_xyxy_px[0] == pytest.approx([208, 100, 248, 200], abs=0.1)
    still = np.array([[208.0, 100, 248, 200]])
    tracks = tracker.update(BoxFrame(10 * FRAME_NS, still, np.ones(1), (640, 480), Turn(0.0)))
    assert tracks.boxes_xyxy_px[0] == pytest.approx(still[0], abs=0.1)


def test_turn_is_the_difference_of_two_directions() -> None:
    turn = turn_between(CameraDirection(3.0, 0.2, 0.05), CameraDirection(-3.0, 0.5, 0.09))
    assert turn == pytest.approx((2 * math.pi - 6.0, 0.2, 0.3))
