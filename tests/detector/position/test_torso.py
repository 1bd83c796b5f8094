import math
from dataclasses import replace

import numpy as np
import pytest

from people4d.messages import F32, U16
from services.detector.models.base import DetectedPerson
from services.detector.position.surface import TORSO, DepthImage
from services.detector.position.torso import LayeredTorso, find_torsos
from services.detector.position.visible_area import cut_to_image
from tests.detector.cameras import lab_info

INFO = lab_info(np.array([600.0, 600.0, 320.0, 240.0]))


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


def torsos(people: list[F32], depth_mm: U16) -> list[LayeredTorso | None]:
    return find_torsos([person(points) for points in people], 0.3, DepthImage(depth_mm, INFO))


def person(points: F32) -> DetectedPerson:
    """Return a person in the box of the torso, with as much below for the legs."""
    low, high = points[TORSO, :2].min(axis=0), points[TORSO, :2].max(axis=0)
    box = np.array([*low, high[0], 2 * high[1] - low[1]], np.float32)
    return DetectedPerson(0.9, box, points)


def one(points: F32, depth_mm: U16) -> LayeredTorso:
    found = torsos([points], depth_mm)[0]
    assert found is not None
    return found


def test_layer_of_a_person_is_on_the_surface_and_joints_are_those_of_the_image() -> None:
    found = one(keypoints(), stand(room()))
    assert found.layer.depth_m == pytest.approx(2.0)
    assert found.joints.known == [True] * 4
    np.testing.assert_allclose(found.joints.joints_px, keypoints()[TORSO, :2])


def test_a_joint_on_the_wall_is_not_the_persons() -> None:
    # The left hip is detected 0.3 m off the body, where depth shows the wall at 4 m.
    points = keypoints()
    points[11, 0] += 90
    assert one(points, stand(room())).layer.depth_m == pytest.approx(2.0)


def test_person_in_front_does_not_count() -> None:
    # A post at 1 m covers the left half: the joints of the right half and the face are at
    # 2 m, and the person is as large in the image as at 2 m.
    points = keypoints()
    points[0] = 315.0, 100.0, 0.9
    depth_mm = stand(room())
    depth_mm[:, 325:420] = 1000
    assert one(points, depth_mm).layer.depth_m == pytest.approx(2.0)


def test_without_depth_or_outside_of_the_image_there_is_no_torso() -> None:
    assert torsos([keypoints(2000.0)], stand(room())) == [None]
    assert torsos([keypoints()], np.zeros((480, 640), np.uint16)) == [None]
    assert torsos([], room()) == []


def test_a_torso_without_readings_has_the_depth_of_its_legs() -> None:
    points = keypoints(z_m=3.4)
    points[[13, 14, 15, 16]] = [(310, 340, 0.9), (330, 340, 0.9), (310, 390, 0.9), (330, 390, 0.9)]
    depth_mm = np.zeros((480, 640), np.uint16)
    depth_mm[300:, :] = 3400
    assert one(points, depth_mm).layer.depth_m == pytest.approx(3.4)


@pytest.mark.parametrize("points", [keypoints(confidence=0.2), None])
def test_without_joints_the_box_gives_the_layer(points: F32 | None) -> None:
    someone = replace(person(keypoints()), keypoints=points)
    (found,) = find_torsos([someone], 0.3, DepthImage(stand(room()), INFO))
    assert found is not None
    assert found.layer.depth_m == pytest.approx(2.0)
    assert not any(found.joints.known)


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
    (found,) = find_torsos([cut_off], 0.3, DepthImage(depth_mm, INFO))
    assert found is not None
    assert found.joints.known == [True, True, False, False]  # hips at the edge are guesses
    assert found.layer.depth_m == pytest.approx(1.2)


@pytest.mark.parametrize("box", [(np.nan,) * 4, (700, 0, 900, 480), (400, 80, 255, 480)])
def test_box_without_area_leaves_the_keypoints(box: tuple[float, ...]) -> None:
    cut_off, depth_mm = side_on()
    found = find_torsos(
        [replace(cut_off, box_xyxy_px=np.array(box, np.float32))], 0.3, DepthImage(depth_mm, INFO)
    )[0]
    assert found is not None
    assert len(found[1].own) == 4  # two shoulders, their middle, the elbow


def test_keypoints_that_are_not_numbers_do_not_count() -> None:
    cut_off, depth_mm = side_on()
    assert cut_off.keypoints is not None
    cut_off.keypoints[[5, 8], :2] = np.nan
    found = find_torsos([cut_off], 0.3, DepthImage(depth_mm, INFO))[0]
    assert found is not None
    assert found[0].known == [False, True, False, False]
    assert found[1].depth_m == pytest.approx(1.2)


def test_only_one_of_two_detections_of_a_person_has_a_torso() -> None:
    first, second = torsos([keypoints(), keypoints()], stand(room()))
    assert first is not None
    assert second is None


def test_people_before_one_another_are_read_in_their_own_layers() -> None:
    # A person at 3 m, half behind a person at 1.8 m; the order of detection does not matter.
    depth_mm = stand(stand(room(), 370.0, 3.0), 300.0, 1.8)
    near, far = keypoints(300.0, 1.8), keypoints(390.0, 3.0)
    for people in ([near, far], [far, near]):
        found = torsos(people, depth_mm)
        depths = sorted(torso.layer.depth_m for torso in found if torso is not None)
        np.testing.assert_allclose(depths, [1.8, 3.0])


def test_wild_keypoints_and_noise_give_finite_layers() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        depth_mm = rng.integers(0, 6000, (480, 640)).astype(np.uint16)
        points = np.column_stack([rng.uniform(-50, 700, (17, 2)), rng.uniform(0, 1, 17)])
        for found in torsos([points.astype(np.float32)] * 2, depth_mm):
            assert found is None or 0 < found.layer.depth_m < 6


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
    (found,) = find_torsos([DetectedPerson(0.9, corners, points)], 0.3, image)
    assert found is not None
    assert found.layer.depth_m == pytest.approx(2.0)


def test_boxes_are_cut_to_the_pixels_of_the_image() -> None:
    right, bottom = INFO.width - 1, INFO.height - 1
    assert cut_to_image((-5.0, 10.0, 9999.0, 9999.0), INFO) == [0.0, 10.0, right, bottom]
    assert cut_to_image((math.nan, 10.0, 20.0, math.nan), INFO) == [0.0, 10.0, 20.0, 0.0]
