"""Random scenes: a function of their options, with the density asked for."""

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from evaluation.recordings.recordings import plan_recordings
from lab.catalogue import load_scenario, resolve
from lab.motion.trajectories import follow
from lab.random_scenario import random_scenario
from lab.scenario import WALKABLE_M
from lab.world import World
from people4d.errors import ConfigError


def write_paths(folder: Path) -> Path:
    """Write paths of twelve people who cross an area of 12 x 8 m at 1.2 m/s, every 0.4 s."""
    rows = []
    for person in range(12):
        y, begin, side = 0.7 * person, 12 * person, 1 if person % 2 else -1
        for k in range(26):
            x = side * (0.48 * k - 6.0)
            rows.append((begin + 6 * k, person + 1, x, 0.0, y, 1.2 * side, 0.0, 0.0))
    np.savetxt(folder / "obsmat.txt", np.array(sorted(rows)), fmt="%.4f")
    return folder


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
        ("random?paths=/nowhere", "paths of pedestrians /nowhere"),
        ("random?room=lab&people=90", "expected room for"),
    ],
)
def test_wrong_option_is_refused_with_its_name(name: str, error: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_scenario(name)
    assert error in str(caught.value)


def test_file_that_holds_no_paths_is_refused(tmp_path: Path) -> None:
    (tmp_path / "obsmat.txt").write_text("1 2 3\n")
    with pytest.raises(ConfigError, match="expected 8 finite columns, got 3"):
        load_scenario(f"random?paths={tmp_path}")


def test_recorded_paths_are_followed(tmp_path: Path) -> None:
    scene = load_scenario(f"random?seed=3&density=0.1&paths={write_paths(tmp_path)}&duration_s=5")
    followed = 0
    for person, motion in zip(scene.people, World(scene).motions, strict=True):
        samples = np.array(person.trajectory)
        inside = (np.abs(samples[:, 1:]) < 9).all(axis=1) & (np.abs(samples[:, 0] - 2.5) < 2)
        times_s, at = samples[inside, 0], samples[inside, 1:]
        if len(at) < 2:
            continue
        followed += 1
        np.testing.assert_allclose(motion.path(times_s)[:, :2], at, atol=0.08)
        # All walk straight on: they face where they go, at 0.75 of 1.2 m/s.
        step = np.diff(at, axis=0)
        np.testing.assert_allclose(np.hypot(*step.T) / np.diff(times_s), 0.9, atol=0.02)
        yaw = motion.path_yaw(float(times_s[0]))
        assert math.cos(yaw - math.atan2(step[0, 1], step[0, 0])) > 0.99
    assert followed > 2


def test_recorded_paths_have_the_density_asked_for_as_nearly_as_they_can(tmp_path: Path) -> None:
    folder = write_paths(tmp_path)
    sparse, dense = (
        random_scenario(f"random?seed=1&density={density}&paths={folder}&duration_s=5")
        for density in (0.05, 0.3)
    )
    assert reached(sparse.about) == pytest.approx(0.05, abs=0.02)
    assert reached(dense.about) > 2 * reached(sparse.about)


def reached(about: str) -> float:
    return float(about.split(": ")[1].split(" ")[0])


def test_relative_paths_become_absolute_for_services(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_paths(tmp_path)
    monkeypatch.chdir(tmp_path.parent)
    source = resolve(f"lab:random?paths={tmp_path.name}&density=0.1@5")
    monkeypatch.chdir("/")
    again = load_scenario(source.removeprefix("lab:"))
    assert again == load_scenario(f"random?paths={tmp_path}&density=0.1", 5)


def test_evaluation_draws_a_scene_for_each_seed(tmp_path: Path) -> None:
    planned = plan_recordings(["lab:random?people=2"], [1, 2], "colour", tmp_path)
    assert [one.name for one in planned] == ["random_people=2@1", "random_people=2@2"]
    assert planned[0].simulation != planned[1].simulation
    assert planned[0].simulation == random_scenario("random?people=2", 1)
    assert planned[0].path != planned[1].path


@pytest.mark.parametrize(
    ("name", "density"), [("seq_eth", 0.15), ("seq_hotel", 0.2), ("zara01", 0.1)]
)
def test_paths_of_real_pedestrians_make_scenes(shared: Path, name: str, density: float) -> None:
    folder = shared / "data" / "trajectories" / name
    scene = load_scenario(f"random?seed=2&density={density}&paths={folder}")
    assert reached(scene.about) == pytest.approx(density, rel=0.25)
    times_s = np.arange(-1.5, 16, 0.01)
    paths = follow([np.array(person.trajectory) for person in scene.people], times_s)
    near = np.hypot(paths.x_m, paths.y_m) < 6
    speeds = np.hypot(np.gradient(paths.x_m, 0.01, axis=1), np.gradient(paths.y_m, 0.01, axis=1))
    # At the hotel many wait at a stop.
    assert 0.4 < np.percentile(speeds[near], 75) < 1.4
    assert np.percentile(speeds[near], 99) < 2.0
