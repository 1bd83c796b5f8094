from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from common.geometry.transforms import apply, project
from lab.catalogue import load_scenario
from lab.drawing.renderer import DepthView, draw_depth
from lab.scenario import PersonPlan
from lab.truth.files import frame_arrays, save_frames
from lab.truth.frames import PersonView, person_views
from lab.truth.motion_capture import capture, velocity_mps
from lab.world import World
from tests.lab.worlds import world

pytestmark = pytest.mark.render

NOSE, EYES, EARS = 0, slice(1, 3), slice(3, 5)


def view_of(of: World, t_s: float) -> DepthView:
    return draw_depth([of.room.mesh, *of.meshes(t_s)], of.optical_from_map(t_s), of.info, 0.05)


@cache
def in_view(name: str, t_s: float) -> tuple[DepthView, tuple[PersonView, ...]]:
    of = world(name)
    view = view_of(of, t_s)
    return view, person_views(of, t_s, view)


def standing(*people: PersonPlan) -> World:
    return World(replace(load_scenario("facing"), people=people))


@pytest.mark.parametrize(
    ("name", "t_s"), [("facing", 0.5), ("short_crossing", 0.8), ("short_robot", 2.0)]
)
def test_keypoints_project_into_masks_where_they_are_visible(name: str, t_s: float) -> None:
    view, people = in_view(name, t_s)
    for k, person in enumerate(people):
        mask = cv2.dilate((view.owners == k + 1).astype(np.uint8), np.ones((5, 5), np.uint8))
        column, row = np.rint(person.keypoints_px[person.visible == 1]).astype(int).T
        assert len(column) >= 5
        assert mask[row, column].all()


def test_keypoints_are_the_projection_of_the_points_in_the_map() -> None:
    of = world("short_robot")
    _, people = in_view("short_robot", 2.0)
    for person in people:
        points = apply(of.optical_from_map(2.0), person.keypoints_m)
        np.testing.assert_allclose(person.keypoints_px, project(points, of.info), atol=1e-9)


def test_all_keypoints_of_a_person_facing_the_camera_are_visible() -> None:
    _, (one, _) = in_view("facing", 0.5)
    assert one.visible.all()
    assert one.visible_share == 1.0
    # Seen from the front, the left side of the body is on the right of the image.
    lefts, rights = one.keypoints_px[1::2, 0], one.keypoints_px[2::2, 0]
    assert np.all(lefts > rights)
    nose, eye, shoulder, hip, knee, ankle = one.keypoints_px[[0, 1, 5, 11, 13, 15], 1]
    assert eye < nose < shoulder < hip < knee < ankle


def test_half_of_a_person_from_the_side_is_hidden() -> None:
    of = standing(PersonPlan(body="bea", start=(3.5, 0.0), face_deg=90.0))
    (person,) = person_views(of, 0.5, view_of(of, 0.5))
    # Facing +y, the left of the body is towards -x, which is towards the camera.
    left, right = person.visible[5::2], person.visible[6::2]
    assert left.all()
    assert right.sum() <= 1
    assert person.visible[[NOSE, 1, 3]].all()
    assert not person.visible[[2, 4]].any()


def test_the_back_of_a_head_shows_no_face() -> None:
    of = standing(PersonPlan(body="adam", start=(3.5, 0.0), face_deg=0.0))
    (person,) = person_views(of, 0.5, view_of(of, 0.5))
    assert not person.visible[NOSE]
    assert not person.visible[EYES].any()
    assert person.visible[5:].all()


def test_boxes_are_just_around_the_pixels_where_nothing_hides_any() -> None:
    view, people = in_view("facing", 0.5)
    for k, person in enumerate(people):
        rows, columns = np.nonzero(view.owners == k + 1)
        expected = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        np.testing.assert_allclose(person.box_xyxy_px, expected, atol=2)


def test_occlusion_reduces_the_visible_share_not_the_box() -> None:
    # One person behind the other; the same body alone has the same box, fully visible.
    front = PersonPlan(body="carlos", start=(3.0, 0.0))
    back = PersonPlan(body="hana", start=(4.2, 0.15))
    together, alone = standing(front, back), standing(back)
    near, far = person_views(together, 0.5, view_of(together, 0.5))
    (free,) = person_views(alone, 0.5, view_of(alone, 0.5))
    np.testing.assert_allclose(far.box_xyxy_px, free.box_xyxy_px, atol=3)  # sway differs
    assert near.visible_share == 1.0
    assert 0.0 < far.visible_share < 0.5
    assert free.visible_share == 1.0
    assert far.visible.sum() < 9 < free.visible.sum()


def test_people_outside_the_image_have_no_box() -> None:
    # At (1.2, 1.3) a person is 1.3 / 1.2 aside of the axis, the image ends at 320 / 615; and one
    # behind the camera has no pixels at all.
    of = standing(
        PersonPlan(body="adam", start=(1.2, 1.3)), PersonPlan(body="bea", start=(-0.3, 1.0))
    )
    aside, behind = person_views(of, 0.5, view_of(of, 0.5))
    for person in (aside, behind):
        assert np.isnan(person.box_xyxy_px).all()
        assert not person.visible.any()
        assert person.position_m[2] > 0.9
    assert np.isfinite(aside.keypoints_px).all()
    assert np.isnan(behind.keypoints_px).all()


def test_file_holds_the_visible_truth(tmp_path: Path) -> None:
    of = world("short_crossing")
    frames = []
    for index in (0, 42):
        view = view_of(of, of.frame_s(index))
        frames.append(frame_arrays(of, index, person_views(of, of.frame_s(index), view), view))
    save_frames(tmp_path / "gt.npz", of.info, frames)
    with np.load(tmp_path / "gt.npz") as file:
        assert file["K"].tolist() == [615, 615, 319.5, 239.5]
        np.testing.assert_allclose(file["t"], [0, 1.4])
        assert file["masks"].shape == (2, 480, 640)
        assert file["masks"].dtype == np.uint8
        assert file["wheelchair"].tolist() == [[False, False]] * 2
        statures_m = [body.skeleton.stature_m for body in of.bodies]
        np.testing.assert_allclose(file["stature"], [statures_m] * 2, rtol=1e-6)
        shapes = {"pos": (3,), "vel": (3,), "yaw": (), "path_yaw": (), "kp3d": (17, 3)}
        shapes |= {"kp2d": (17, 2), "kpvis": (17,), "bbox": (4,), "vis": ()}
        assert {name: file[name].shape for name in shapes} == {
            name: (2, 2, *shape) for name, shape in shapes.items()
        }
        np.testing.assert_allclose(file["T_world_cam"][1], of.map_from_optical(1.4))
        truth = [capture(of, k, 0.0).position_m for k in (0, 1)]
        np.testing.assert_allclose(file["pos"][0], truth)
        np.testing.assert_allclose(file["vel"][0], [velocity_mps(of, k, 0.0) for k in (0, 1)])
