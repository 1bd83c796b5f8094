"""Groups of positions of one person by several cameras, and positions between grid steps."""

import numpy as np
import pytest

from common.calibration.groups import find_groups
from common.calibration.level_paths import LevelPaths
from common.calibration.pairs import LevelPose
from common.calibration.tracklets import STEP_S, Tracklet
from people4d.messages import F64


def level_paths(camera: str, *paths: F64, first: int = 0) -> LevelPaths:
    """Build paths (Nx3) of a camera whose optical frame is the level one."""
    made = [Tracklet(first, path, np.gradient(path, STEP_S, axis=0)) for path in paths]
    return LevelPaths(camera, np.eye(3), None, made)


def circle(steps: int, middle_m: tuple[float, float], late_s: float = 0.0) -> F64:
    angle = (np.arange(steps) * STEP_S + late_s) * 1.2
    x, y = middle_m[0] + np.cos(angle), middle_m[1] + np.sin(angle)
    return np.column_stack([x, y, np.full(steps, 1.1)])


def test_positions_between_steps_follow_the_curve() -> None:
    paths = level_paths("a", circle(30, (0, 0)))
    positions, velocities = paths.between(0.3)
    expected = circle(30, (0, 0), 0.3 * STEP_S)
    np.testing.assert_allclose(positions[1:-2, 0], expected[1:-2], atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(velocities[1:-2, 0], axis=1), 1.2, atol=0.02)
    assert np.isnan(positions[-1]).all()


def test_paths_that_follow_each_other_are_not_joined_by_a_curve() -> None:
    near, far = circle(10, (0, 0)), circle(10, (9, 9))
    paths = LevelPaths(
        "a", np.eye(3), None, [Tracklet(0, near, 0 * near), Tracklet(10, far, 0 * far)]
    )
    positions, _ = paths.between(0.5)
    assert np.nanmax(positions[:9, :, 0]) < 2
    assert np.isnan(positions[9]).all()


def test_people_of_three_cameras_are_grouped_at_one_time() -> None:
    # Camera b stands 1 m to the right and its clock is 0.25 s ahead; c has the first person alone.
    one, other = circle(40, (3, 0)), circle(40, (6, 1))
    moved = [circle(40, m, -0.25) - (0, 1, 0) for m in ((3, 0), (6, 1))]
    cameras = [level_paths("a", one, other), level_paths("b", *moved), level_paths("c", one)]
    still = LevelPose(0.0, np.zeros(3), 0.0)
    poses = {"a": still, "b": LevelPose(0.0, np.array([0.0, 1, 0]), 0.25), "c": still}
    groups = find_groups(cameras, poses, 0.3, 0)
    both, three = ~groups.has[:, 2], groups.has.all(axis=1)
    assert (both ^ three | ~groups.has[:, 1]).all()
    assert both.sum() == pytest.approx(37, abs=2)
    apart = groups.points_m[three, 0] - (groups.points_m[three, 1] + (0, 1, 0))
    np.testing.assert_allclose(apart, 0, atol=1e-3)
