"""The correction of camera turns, worked by hand: its sign, its size, its effect."""

import math

import numpy as np
import pytest

from common.geometry.transforms import project, rotation_from_rpy
from people4d.messages import F64
from services.tracker.config import ImageSortConfig
from services.tracker.image_sort.box_kalman import TRACK, begin
from services.tracker.image_sort.camera_turn import Lens, Turn, turn_tracks
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


def test_pinhole_points_move_by_their_position() -> None:
    # Points all over the image, before and after a turn by 5 degrees to the left.
    turn_rad = math.radians(5)
    points = np.array([[4.0, y, z] for y in (-2.0, 0.0, 1.5) for z in (-1.0, 0.0, 1.0)])
    for before, after in zip(detected(points, 0.0), detected(points, turn_rad), strict=True):
        track = begun(*before)
        turn_tracks(track, Turn(turn_rad), Lens(0.0, 400.0, 320.0, 240.0))
        np.testing.assert_allclose(track["x"][:2], after, atol=1e-9)


def test_pinhole_points_of_a_tilted_camera_move_by_their_position() -> None:
    up_rad = math.radians(5)
    points = np.array([[4.0, y, z] for y in (-2.0, 0.0, 1.5) for z in (-1.0, 0.0, 1.0)])
    for before, after in zip(detected(points, 0.0), detected(points, 0.0, up_rad), strict=True):
        track = begun(*before)
        turn_tracks(track, Turn(0.0, up_rad=up_rad), Lens(0.0, 400.0, 320.0, 240.0))
        np.testing.assert_allclose(track["x"][:2], after, atol=1e-9)


def test_a_tilted_camera_sees_boxes_grow_towards_the_rim() -> None:
    # At 20 degrees below the axis, then at 30: as wide as before times cos 20 / cos 30, as high
    # times its square, so width over height is less by it.
    v = 240 + 400 * math.tan(math.radians(20))
    track = begun(320, v, 2, 2)
    turn_tracks(track, Turn(0.0, up_rad=math.radians(10)), Lens(0.0, 400.0, 320.0, 240.0))
    grown = math.cos(math.radians(20)) / math.cos(math.radians(30))
    assert track["x"][2] == pytest.approx(4 * grown**3)
    assert track["x"][3] == pytest.approx(1 / grown)


def test_a_pinhole_camera_sees_boxes_grow_towards_the_rim() -> None:
    # A small square at 20 degrees right of the axis, then at 30: as high as before times
    # cos 20 / cos 30, as wide as before times its square.
    u = 320 + 400 * math.tan(math.radians(20))
    track = begun(u, 240, 2, 2)
    turn_tracks(track, Turn(math.radians(10)), Lens(0.0, 400.0, 320.0, 240.0))
    grown = math.cos(math.radians(20)) / math.cos(math.radians(30))
    assert track["x"][2] == pytest.approx(4 * grown**3)
    assert track["x"][3] == pytest.approx(grown)


def test_point_turned_behind_the_camera_stays_finite() -> None:
    track = begun(600, 240)
    turn_tracks(track, Turn(3.0), Lens(0.0, 400.0, 320.0, 240.0))
    assert np.isfinite(track["x"]).all()


def standing(config: ImageSortConfig, px_per_frame: float, turn: Turn) -> list[list[int]]:
    """Return the identities of a standing person while the camera turns in jerks."""
    tracker, results = ImageSort(config), []
    u = 100.0
    for number in range(12):
        jerk = number % 3 == 2  # the camera turns in every third frame only
        u += px_per_frame * jerk
        box = np.array([[u - 20, 100, u + 20, 200]])
        frame = BoxFrame(
            number * FRAME_NS, box, np.ones(1), (640, 480), turn if jerk else Turn(0.0), 60.0
        )
        results.append(tracker.update(frame).ids.tolist())
    return results


@pytest.mark.parametrize("projection", ["linear", "pinhole"])
def test_a_standing_person_keeps_the_identity_only_with_the_correction(projection: str) -> None:
    # 30 px a jerk: boxes 40 px wide overlap by 10/70 < 0.3. 60 degrees over 640 px, so that is
    # 2.8 degrees at every place, or less than that near the middle of a pinhole's image.
    turn = Turn(math.radians(60 * 30 / 640))
    base = {"confirm": "once", "min_hits": 0, "projection": projection}
    corrected = ImageSortConfig(**base, ego_motion="odometry")  # type: ignore[arg-type]
    plain = ImageSortConfig(**base)  # type: ignore[arg-type]
    assert standing(corrected, 30.0, turn) == [[1]] * 12
    assert standing(plain, 30.0, turn)[-1][0] > 3
    # The wrong sign is worse than none.
    assert standing(corrected, -30.0, turn)[-1][0] > 3


def test_the_velocity_holds_only_the_persons_own_motion() -> None:
    # A steady turn of 12 px a frame; after ten frames a prediction without a turn stays in place.
    config = ImageSortConfig(confirm="once", min_hits=0, ego_motion="odometry")
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
