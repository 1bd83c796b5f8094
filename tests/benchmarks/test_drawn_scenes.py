"""Scenes of the second simulator, drawn from seeds without rendering."""

import math
from itertools import combinations

import numpy as np
import pytest

from benchmarks.lib.gait.drawn_scenes import APART_M, draw_scene, drawn_scenes
from benchmarks.lib.gait.other_walkers import Drive, Walk

NAMES = [name for name, _ in drawn_scenes()]
SLACK_M = 0.1  # coarser steps of the check


def test_split_has_at_least_thirty_scenes_of_different_seeds() -> None:
    assert len({seed for _, seed in drawn_scenes()}) == len(NAMES) >= 30


@pytest.mark.parametrize("name", NAMES[:6])
def test_people_of_a_drawn_scene_keep_apart(name: str) -> None:
    scene = draw_scene(name)
    walks = [Walk(style) for style in scene.people]
    for _ in range(round(scene.seconds * 10)):
        for walk in walks:
            walk.advance(0.1)
        for one, other in combinations(walks, 2):
            assert math.dist((one.x_m, one.y_m), (other.x_m, other.y_m)) > APART_M - SLACK_M


def test_scene_of_the_same_seed_is_the_same() -> None:
    assert repr(draw_scene(NAMES[0])) == repr(draw_scene(NAMES[0]))


def test_odometry_without_errors_is_the_motion() -> None:
    drive = Drive((0.2, 0.5, 1.0), (0.3, 0.4, 2.0), (0.4, 0.8, 0.5), gyro_rad=0.0)
    poses = drive.poses(np.arange(50) / 10)
    assert poses[0] == pytest.approx(np.zeros(3))
    assert drive.odometry(poses, np.random.default_rng(0)) == pytest.approx(poses)


def test_odometry_of_scaled_wheels_drifts_by_the_scale() -> None:
    straight = Drive((0.2, 0.5, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0), (1.02, 1.0), 0.0)
    poses = straight.poses(np.arange(20) / 10)
    reported = straight.odometry(poses, np.random.default_rng(0))
    assert reported[:, 0] == pytest.approx(1.02 * poses[:, 0])
