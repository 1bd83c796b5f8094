"""Objects that look like people: their sizes, depth, labels, and that people avoid them."""

import math
from typing import get_args

import numpy as np
import pytest

from lab.camera.plan import CameraPlan
from lab.drawing.renderer import DepthView, Instant, Renderer, draw_depth
from lab.furniture import SIZES_M, ObjectKind, ObjectPlan
from lab.lookalikes import LOW_M, MIRROR_M, POSTER_M, SCREEN_M, Lookalike
from lab.random_scenario import random_scenario
from lab.scenario import PersonPlan, Scenario, Waypoint
from lab.truth.files import frame_arrays
from lab.truth.frames import person_views
from lab.world import World

pytestmark = pytest.mark.render

CAMERA = CameraPlan(
    at=(0.0, 0.0, 1.2), pitch_deg=0.0, width=160, height=120, focal_px=140.0, avoided=False
)
ADAM = PersonPlan(body="adam", start=(2.5, 1.2))


def scene(*objects: ObjectPlan, people: tuple[PersonPlan, ...] = ()) -> World:
    scenario = Scenario(
        about="Objects.", duration_s=5.0, camera=CAMERA, objects=objects, people=people
    )
    return World(scenario, 1)


def view(world: World, t_s: float = 0.0) -> DepthView:
    meshes = [world.room.mesh, *world.surfaces(t_s)]
    return draw_depth(meshes, world.optical_from_map(t_s), world.info, 0.05)


@pytest.mark.parametrize(
    ("kind", "low_m", "high_m"),
    [
        ("poster", LOW_M + POSTER_M[1] - 1e-6, LOW_M + POSTER_M[1] + 1e-6),
        ("screen", LOW_M + SCREEN_M[1] - 1e-6, LOW_M + SCREEN_M[1] + 1e-6),
        ("mirror", LOW_M + MIRROR_M[1] - 1e-6, LOW_M + MIRROR_M[1] + 1e-6),
        ("mannequin", 1.80, 1.86),
        ("robot", 1.2, 1.7),
    ],
)
def test_object_stands_on_the_floor_with_the_size_of_its_kind(
    kind: ObjectKind, low_m: float, high_m: float
) -> None:
    for seed in range(4):
        mesh = Lookalike(ObjectPlan(kind=kind, at=(0.0, 0.0)), seed, 0, 2.0).mesh(0.0)
        bottom_m, top_m = mesh.vertices_m[:, 2].min(), mesh.vertices_m[:, 2].max()
        assert bottom_m == pytest.approx(0.0, abs=0.03)
        assert low_m <= top_m <= high_m
        assert np.ptp(mesh.vertices_m[:, 1]) <= SIZES_M[kind][0] + 0.02
        assert not mesh.owner.any()


def test_poster_is_flat_and_shows_a_figure() -> None:
    world = scene(ObjectPlan(kind="poster", at=(3.0, 0.0), yaw_deg=180.0))
    depth_m = view(world).depth_m[20:100, 65:95]
    assert np.ptp(depth_m) < 0.01
    assert depth_m.mean() == pytest.approx(3.0, abs=0.01)
    colour = Renderer(world.room, world.info, 1).radiance(
        Instant(world.surfaces(0.0), world.optical_from_map(0.0))
    )
    assert colour[20:100, 65:95].std(axis=(0, 1)).min() > 0.02


def test_figure_on_a_screen_moves_and_others_do_not() -> None:
    kinds = get_args(ObjectKind)
    moves = {}
    for kind in kinds:
        thing = Lookalike(ObjectPlan(kind=kind, at=(1.0, 0.5), yaw_deg=30.0), 1, 0, 6.0)
        moves[kind] = np.abs(thing.mesh(3.0).vertices_m - thing.mesh(0.0).vertices_m).max()
    assert {kind for kind in kinds if moves[kind] > 0} == {"screen"}
    assert moves["screen"] > 0.3


def test_depth_in_a_mirror_is_the_distance_of_the_virtual_image() -> None:
    """A mirror at x = 3 m shows the wall behind the camera, at x = -0.6 m, at 6.6 m."""
    world = scene(ObjectPlan(kind="mirror", at=(3.0, 0.0), yaw_deg=180.0))
    assert view(world).depth_m[40:60, 75:85] == pytest.approx(3.0 + 3.6, abs=0.02)


def test_person_in_a_mirror_is_visible_and_has_no_mask() -> None:
    """A mirror at 45 degrees at (2.5, 0) shows (2.5, 1.2), from the side, at (3.7, 0)."""
    mirror = ObjectPlan(kind="mirror", at=(2.5, 0.0), yaw_deg=135.0)
    with_adam, without = scene(mirror, people=(ADAM,)), scene(mirror)
    shown, empty = view(with_adam), view(without)
    changed = (np.abs(shown.depth_m - empty.depth_m) > 0.05) & (shown.owners == 0)
    assert changed[45:75, 79:83].all()
    image_m = shown.depth_m[45:75, 79:83]
    assert 3.7 - 0.3 < image_m.min() < image_m.max() < 3.7
    radiance = [
        Renderer(one.room, one.info, 1).radiance(
            Instant(one.surfaces(0.0), one.optical_from_map(0.0))
        )
        for one in (with_adam, without)
    ]
    assert np.abs(radiance[0] - radiance[1])[changed].mean() > 0.02


def test_truth_has_kind_pose_and_box_of_each_object() -> None:
    """A poster 0.85 m wide at 3 m is 140 * 0.85 / 3 = 40 px wide, and its foot is narrower."""
    world = scene(ObjectPlan(kind="poster", at=(3.0, 0.0), yaw_deg=180.0), people=(ADAM,))
    frame = view(world)
    arrays = frame_arrays(world, 0, person_views(world, 0.0, frame), frame)
    assert arrays["object_kind"].tolist() == ["poster"]
    assert arrays["object_pose"] == pytest.approx(np.array([[3.0, 0.0, math.pi]]))
    left, top, right, _ = arrays["object_bbox"][0]
    assert right - left == pytest.approx(40, abs=1.5)
    # The upper edge is 2.1 m high, the camera 1.2 m: 59.5 - 140 * 0.9 / 3 = 17.5.
    assert top == pytest.approx(17.5, abs=1.5)


def test_people_walk_round_objects() -> None:
    walker = PersonPlan(body="bea", start=(1.0, 0.0), path=(Waypoint(to=(4.0, 0.05)),))
    robot = ObjectPlan(kind="robot", at=(2.5, 0.0))
    (motion,) = scene(robot, people=(walker,)).motions
    assert not any(robot.holds(x, y, 0.1) for x, y, _ in motion.path(np.arange(0, 5, 0.05)))


def test_random_scene_draws_objects_of_all_kinds_apart_from_people() -> None:
    usual, kinds = random_scenario("random?people=2", 0), set[str]()
    for seed in range(8):
        chosen = random_scenario("random?people=2&objects=2", seed)
        assert len(chosen.objects) == 2
        kinds |= {thing.kind for thing in chosen.objects}
        for person in chosen.people:
            assert not any(t.holds(*at, 0.2) for t in chosen.objects for at in person.positions())
    assert kinds == set(get_args(ObjectKind))
    assert usual.objects == ()
