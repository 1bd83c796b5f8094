import math
from dataclasses import replace

import numpy as np
import pytest

from people4d.messages import F32, U16
from services.detector.config import DetectorConfig
from services.detector.models.base import DetectedPerson, InstanceMask
from services.detector.position.axis import BODY_M, SURFACE_M, Ellipse
from services.detector.position.surface import TORSO, DepthImage, PositionEstimate
from services.detector.position.torso import TorsoEstimator
from services.detector.position.visible_area import cut_to_image
from tests.detector.cameras import lab_info

INFO = lab_info(np.array([600.0, 600.0, 320.0, 240.0]))
CYLINDER = Ellipse(half_depth_m=0.15, half_width_m=0.15)
DEPTH_PER_M = DetectorConfig().depth_error_per_m
SURFACE = TorsoEstimator(None, DEPTH_PER_M)
AXIS = TorsoEstimator(CYLINDER, DEPTH_PER_M)
FACING_RAD = math.pi


def room() -> U16:
    """A wall at 4 m."""
    return np.full((480, 640), 4000, np.uint16)


def keypoints(u: float = 320.0, z_m: float = 2.0, confidence: float = 0.9) -> F32:
    """Return a person facing the camera, with the middle in row 240."""
    points = np.zeros((17, 3), np.float32)
    scale = 600.0 / z_m
    for joint, x, y in zip(
        TORSO, (0.16, -0.16, 0.1, -0.1), (-0.25, -0.25, 0.25, 0.25), strict=True
    ):
        points[joint] = u + scale * x, 240 + scale * y, confidence
    return points


def stand(depth_mm: U16, u: float = 320.0, z_m: float = 2.0) -> U16:
    """Put a board 0.5 m wide and 1.7 m high in front of the scene."""
    left, right = round(u - 150 / z_m), round(u + 150 / z_m)
    top, bottom = max(round(240 - 360 / z_m), 0), min(round(240 + 660 / z_m), 480)
    board = depth_mm[top:bottom, left:right]
    board[:] = np.minimum(board, round(z_m * 1000))
    return depth_mm


def estimates(
    estimator: TorsoEstimator, people: list[F32], depth_mm: U16, yaw_rad: float | None = None
) -> list[PositionEstimate | None]:
    image = DepthImage(depth_mm, INFO)
    torsos = estimator.find_torsos([person(points) for points in people], 0.3, image)
    return estimator.estimate(torsos, image.info, [yaw_rad] * len(torsos))


def person(points: F32) -> DetectedPerson:
    """Return a person in the box of the torso, with as much below for the legs."""
    low, high = points[TORSO, :2].min(axis=0), points[TORSO, :2].max(axis=0)
    box = np.array([*low, high[0], 2 * high[1] - low[1]], np.float32)
    return DetectedPerson(0.9, box, points)


def one(
    estimator: TorsoEstimator, points: F32, depth_mm: U16, yaw_rad: float | None = None
) -> PositionEstimate:
    found = estimates(estimator, [points], depth_mm, yaw_rad)[0]
    assert found is not None
    return found


def test_the_middle_of_shoulders_and_hips_on_the_surface() -> None:
    estimate = one(SURFACE, keypoints(), stand(room()))
    np.testing.assert_allclose(estimate.position_m, [0.0, 0.0, 2.0], atol=1e-6)


def test_to_the_right_the_same_person_is_as_wide_of_the_axis_as_the_ray() -> None:
    # 150 px to the right at 2 m: 0.5 m.
    estimate = one(SURFACE, keypoints(470.0), stand(room(), 470.0))
    np.testing.assert_allclose(estimate.position_m, [0.5, 0.0, 2.0], atol=1e-6)


def test_the_axis_of_a_cylinder_from_the_front() -> None:
    # A cylinder of 0.15 m radius, its axis at 2 m: at column u, x = (u - 320) z / 600 and
    # z = 2 - sqrt(0.15^2 - x^2), nearly the same x at z = 1.87 m.
    depth_mm = room()
    for column in range(270, 371):
        x = (column - 320) * 1.87 / 600
        if abs(x) < 0.15:
            depth_mm[60:460, column] = round(1000 * (2.0 - math.sqrt(0.15**2 - x**2)))
    points = keypoints()
    estimate = one(AXIS, points, depth_mm, FACING_RAD)
    assert estimate.position_m[2] == pytest.approx(2.0, abs=0.01)
    surface = one(SURFACE, points, depth_mm, FACING_RAD)
    assert 0.10 < estimate.position_m[2] - surface.position_m[2] <= 0.15


def test_a_joint_on_the_wall_is_not_the_persons() -> None:
    # The left hip is detected 0.3 m off the body, where depth shows the wall at 4 m.
    points = keypoints()
    points[11, 0] += 90
    estimate = one(SURFACE, points, stand(room()))
    assert estimate.position_m[2] == pytest.approx(2.0)


def test_person_in_front_does_not_count() -> None:
    # A post at 1 m covers the left half: the joints of the right half and the face are at
    # 2 m, and the person is as large in the image as at 2 m.
    points = keypoints()
    points[0] = 315.0, 100.0, 0.9
    depth_mm = stand(room())
    depth_mm[:, 325:420] = 1000
    estimate = one(SURFACE, points, depth_mm)
    np.testing.assert_allclose(estimate.position_m, [0.0, 0.0, 2.0], atol=1e-6)


@pytest.mark.parametrize("hidden", TORSO)
def test_a_hidden_joint_leaves_the_middle_where_it_is(hidden: int) -> None:
    points = keypoints()
    points[hidden] = 0.0, 0.0, 0.1
    depth_mm = stand(room())
    estimate = one(SURFACE, points, depth_mm, FACING_RAD)
    np.testing.assert_allclose(estimate.position_m, [0.0, 0.0, 2.0], atol=0.015)
    full = one(SURFACE, keypoints(), depth_mm, FACING_RAD)
    assert estimate.covariance_m2 is not None
    assert full.covariance_m2 is not None
    assert estimate.covariance_m2[0, 0] > full.covariance_m2[0, 0]


def test_shoulders_alone_give_the_middle_below_them() -> None:
    points = keypoints()
    points[11:13] = 0.0, 0.0, 0.1
    estimate = one(SURFACE, points, stand(room()))
    np.testing.assert_allclose(estimate.position_m, [0.0, 0.0, 2.0], atol=0.01)


def test_depth_of_near_people_has_less_variance() -> None:
    # Five windows agree: (0.0036 z^2)^2 / 5 and 0.16 m to the unknown axis and the body's 0.035.
    for z_m in (1.5, 3.0):
        estimate = one(SURFACE, keypoints(z_m=z_m), stand(room(), z_m=z_m))
        assert estimate.covariance_m2 is not None
        expected = (DEPTH_PER_M * z_m**2) ** 2 / 5 + BODY_M**2 + SURFACE_M**2
        assert estimate.covariance_m2[2, 2] == pytest.approx(expected)


def test_without_depth_or_outside_of_the_image_there_is_no_position() -> None:
    assert estimates(SURFACE, [keypoints(2000.0)], stand(room())) == [None]
    assert estimates(SURFACE, [keypoints()], np.zeros((480, 640), np.uint16)) == [None]
    assert estimates(SURFACE, [], room()) == []


def test_a_torso_without_readings_has_the_depth_of_its_legs() -> None:
    points = keypoints(z_m=3.4)
    points[[13, 14, 15, 16]] = [(310, 340, 0.9), (330, 340, 0.9), (310, 390, 0.9), (330, 390, 0.9)]
    depth_mm = np.zeros((480, 640), np.uint16)
    depth_mm[300:, :] = 3400
    assert one(SURFACE, points, depth_mm).position_m[2] == pytest.approx(3.4, abs=0.07)


def test_without_joints_the_box_gives_the_position() -> None:
    # 0.55 m below the upper edge of the box, 165 px at 2 m: row 165 + 165 = 330, y = 0.3 m; the
    # face or the middle of the box may be 0.15 m off the torso.
    estimate = one(SURFACE, keypoints(confidence=0.2), stand(room()))
    np.testing.assert_allclose(estimate.position_m, [0.0, 0.3, 2.0], atol=0.02)
    assert estimate.covariance_m2 is not None
    assert estimate.covariance_m2[0, 0] == pytest.approx(0.15**2)


def side_on(z_m: float = 1.2) -> tuple[DetectedPerson, U16]:
    """Return a near person from the side, cut off above the hips, and a wall at 4 m.

    The shoulders are 25 px apart, as if 7.7 m away; the elbow lies on the wall, and the hips are
    guessed at the lower edge of the image.
    """
    depth_mm = room()
    depth_mm[80:, 260:380] = round(z_m * 1000)
    points = np.zeros((17, 3), np.float32)
    points[[5, 6, 8, 11, 12]] = [
        (308, 320, 0.5),
        (333, 322, 0.5),
        (395, 420, 0.4),
        (310, 478, 0.35),
        (330, 478, 0.35),
    ]
    return DetectedPerson(0.4, np.array([255, 80, 400, 480], np.float32), points), depth_mm


def test_near_person_from_the_side_without_hips_is_not_put_on_the_wall() -> None:
    cut_off, depth_mm = side_on()
    image = DepthImage(depth_mm, INFO)
    torsos = AXIS.find_torsos([cut_off], 0.3, image)
    assert torsos[0] is not None
    known = torsos[0][0].known
    assert known == [True, True, False, False]  # hips at the edge are guesses
    (estimate,) = AXIS.estimate(torsos, image.info, [None])
    assert estimate is not None
    assert estimate.position_m[2] == pytest.approx(1.35, abs=0.02)
    assert estimate.covariance_m2 is not None
    assert abs(estimate.position_m[2] - 1.35) < 2 * math.sqrt(estimate.covariance_m2[2, 2])


@pytest.mark.parametrize("box", [(np.nan,) * 4, (700, 0, 900, 480), (400, 80, 255, 480)])
def test_box_without_area_leaves_the_keypoints(box: tuple[float, ...]) -> None:
    cut_off, depth_mm = side_on()
    found = AXIS.find_torsos(
        [replace(cut_off, box_xyxy_px=np.array(box, np.float32))], 0.3, DepthImage(depth_mm, INFO)
    )[0]
    assert found is not None
    assert len(found[1].own) == 4  # two shoulders, their middle, the elbow


def test_keypoints_that_are_not_numbers_do_not_count() -> None:
    cut_off, depth_mm = side_on()
    assert cut_off.keypoints is not None
    cut_off.keypoints[[5, 8], :2] = np.nan
    found = AXIS.find_torsos([cut_off], 0.3, DepthImage(depth_mm, INFO))[0]
    assert found is not None
    assert found[0].known == [False, True, False, False]
    assert found[1].depth_m == pytest.approx(1.2)


def test_only_one_of_two_detections_of_a_person_has_a_position() -> None:
    first, second = estimates(SURFACE, [keypoints(), keypoints()], stand(room()))
    assert first is not None
    assert second is None


def test_people_before_one_another_are_read_in_their_own_layers() -> None:
    # A person at 3 m, half behind a person at 1.8 m; the order of detection does not matter.
    depth_mm = stand(stand(room(), 370.0, 3.0), 300.0, 1.8)
    near, far = keypoints(300.0, 1.8), keypoints(390.0, 3.0)
    for people in ([near, far], [far, near]):
        found = estimates(SURFACE, people, depth_mm)
        depths = sorted(float(p.position_m[2]) for p in found if p is not None)
        np.testing.assert_allclose(depths, [1.8, 3.0])


def test_the_upper_middle_of_a_mask() -> None:
    # Rows 100 to 400, columns 300 to 340: row means 320; rows at 0.2 to 0.5 of 300 px, 160 to 250,
    # mean 205: y = (205 - 240) * 2 / 600 = -0.1167.
    mask = InstanceMask(np.ones((301, 41), np.uint8), x_px=300, y_px=100)
    estimate = SURFACE.estimate_from_mask(mask, DepthImage(stand(room()), INFO), None)
    assert estimate is not None
    np.testing.assert_allclose(estimate.position_m, [0.0, -35 * 2 / 600, 2.0], atol=0.002)


def test_masks_without_pixels_or_depth_have_no_position() -> None:
    wall = DepthImage(room(), INFO)
    empty = InstanceMask(np.zeros((10, 10), np.uint8), 0, 0)
    assert SURFACE.estimate_from_mask(empty, wall, None) is None
    mask = InstanceMask(np.ones((10, 10), np.uint8), 630, 470)
    assert SURFACE.estimate_from_mask(mask, DepthImage(0 * room(), INFO), None) is None
    single = InstanceMask(np.ones((1, 1), np.uint8), 639, 479)
    assert SURFACE.estimate_from_mask(single, wall, None) is not None


def test_wild_keypoints_and_noise_give_finite_positions() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        depth_mm = rng.integers(0, 6000, (480, 640)).astype(np.uint16)
        points = np.column_stack([rng.uniform(-50, 700, (17, 2)), rng.uniform(0, 1, 17)])
        yaw_rad = float(rng.uniform(-3, 3))
        for yaw in (yaw_rad, None):
            for estimate in estimates(AXIS, [points.astype(np.float32)] * 2, depth_mm, yaw):
                if estimate is None:
                    continue
                assert estimate.covariance_m2 is not None
                assert np.isfinite(estimate.position_m).all()
                assert np.linalg.eigvalsh(estimate.covariance_m2)[0] > 0


@pytest.mark.parametrize(("arm", "box"), [((0, 20), (0, 60)), ((620, 640), (580, 640))])
def test_person_beside_the_image_is_not_on_the_wall(
    arm: tuple[int, int], box: tuple[int, int]
) -> None:
    # An arm of 20 px at the edge of the image, in a box of 60 px: the rest of it is the wall.
    depth_mm = room()
    depth_mm[100:400, slice(*arm)] = 2000
    points = np.zeros((17, 3), np.float32)
    corners = np.array([box[0], 100, box[1], 400], np.float32)
    image = DepthImage(depth_mm, INFO)
    torsos = SURFACE.find_torsos([DetectedPerson(0.9, corners, points)], 0.3, image)
    (estimate,) = SURFACE.estimate(torsos, image.info, [None])
    assert estimate is not None
    assert estimate.position_m[2] == pytest.approx(2.0)


def test_boxes_are_cut_to_the_pixels_of_the_image() -> None:
    right, bottom = INFO.width - 1, INFO.height - 1
    assert cut_to_image((-5.0, 10.0, 9999.0, 9999.0), INFO) == [0.0, 10.0, right, bottom]
    assert cut_to_image((math.nan, 10.0, 20.0, math.nan), INFO) == [0.0, 10.0, 20.0, 0.0]
