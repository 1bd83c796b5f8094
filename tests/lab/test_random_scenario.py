"""Random scenes: a function of their options, with the requested density."""

from pathlib import Path

import msgspec
import pytest

from evaluation.recordings.recordings import plan_recordings
from lab.bodies.cast import child_names
from lab.catalogue import load_scenario
from lab.random_scenario import CHILD_MPS, random_scenario
from lab.scenario import WALKABLE_M
from people4d.errors import ConfigError


def test_same_options_give_the_same_scene_and_other_seeds_others() -> None:
    one = load_scenario("random?seed=7&density=0.2")
    assert msgspec.json.encode(one) == msgspec.json.encode(load_scenario("random?density=0.2", 7))
    assert one.people != load_scenario("random?seed=8&density=0.2").people
    assert one.name == load_scenario("random?seed=8&density=0.2").name == "random_density=0.2"


@pytest.mark.parametrize("room", ["lab", "hall", "office"])
@pytest.mark.parametrize("density", [0.05, 0.2])
def test_density_is_in_people_per_square_metre(room: str, density: float) -> None:
    scene = load_scenario(f"random?density={density}&room={room}")
    (x0, y0), (x1, y1) = WALKABLE_M[scene.room]
    area_m2 = (x1 - x0) * (y1 - y0)
    assert len(scene.people) == max(1, round(density * area_m2))


def test_scenes_vary_in_camera_light_clothes_and_furniture() -> None:
    scenes = [random_scenario("random", seed) for seed in range(30)]
    heights = [scene.camera.at[2] for scene in scenes]
    assert min(heights) < 1.2
    assert max(heights) > 2.1
    assert {scene.camera.avoided for scene in scenes} == {True, False}
    assert len({scene.camera.image.brightness for scene in scenes}) == 30
    assert {person.outfit for scene in scenes for person in scene.people} == {"dark", "random"}
    assert {piece.kind for scene in scenes for piece in scene.furniture} == {
        *("desk", "chair", "partition", "cabinet")
    }
    assert all(scene.camera.fps == 10 for scene in scenes)


def test_first_people_are_children_and_the_next_in_wheelchairs() -> None:
    usual = random_scenario("random?people=5", 3)
    scene = random_scenario("random?people=5&children=2&wheelchairs=1", 3)
    assert [p.body in child_names() for p in scene.people] == [True, True, False, False, False]
    assert [p.wheelchair for p in scene.people] == [False, False, True, False, False]
    assert all(person.speed_mps <= CHILD_MPS for person in scene.people[:2])
    assert scene.people[3:] == usual.people[3:]
    assert [p.path for p in scene.people] == [p.path for p in usual.people]


def test_plain_scene_has_no_weaknesses_of_a_camera() -> None:
    camera = random_scenario("random?plain=true&depth_sensor=d435i&outfit=own").camera
    assert camera.image == type(camera.image)()
    assert (camera.exposure_s, camera.depth_lag_s, camera.depth_sensor) == (0.0, 0.0, "d435i")


@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("random?density=9", "density: expected `float` <= 1.0"),
        ("random?colour=red", "unknown field `colour`"),
        ("random?view=sky", "view: "),
        ("random?room=lab&people=90", "expected room for"),
    ],
)
def test_wrong_option_is_refused_with_its_name(name: str, error: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_scenario(name)
    assert error in str(caught.value)


def test_evaluation_draws_a_scene_for_each_seed(tmp_path: Path) -> None:
    planned = plan_recordings(["lab:random?people=2"], [1, 2], "colour", tmp_path)
    assert [one.name for one in planned] == ["random_people=2@1", "random_people=2@2"]
    assert planned[0].simulation != planned[1].simulation
    assert planned[0].simulation == random_scenario("random?people=2", 1)
    assert planned[0].path != planned[1].path
