"""Positions for the event detectors of other packages, and the matching of their landings."""

import numpy as np
import pytest

from benchmarks.lib.gait.bodies import matched
from benchmarks.lib.gait.event_peers import along_path, grid_s
from benchmarks.lib.gait.steps_by_eye import StepByEye, StepsByEye, counts
from lab.truth.motion_capture import Footfall
from people4d.messages import F64
from services.gait.steps.steps import PointTrajectory

TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def trajectory(times_s: F64, points_m: F64) -> PointTrajectory:
    return PointTrajectory(times_s, points_m, np.tile(1e-4 * np.eye(3), (len(times_s), 1, 1)))


@pytest.mark.parametrize("turn", [np.eye(3), TURN, -TURN @ np.diag([1.0, 1.0, -1.0])])
def test_coordinates_along_the_path_do_not_depend_on_its_direction(turn: F64) -> None:
    # 1 m/s along x; the left foot is 0.1 m to the left, the right one 0.1 m to the right.
    times_s = np.arange(0, 3, 0.1)
    body = np.stack([times_s, 0 * times_s, 0 * times_s + 1.6], axis=1)
    points = {
        "head": body,
        "left_foot": body + np.array([0.0, 0.1, -1.5]),
        "right_foot": body - np.array([0.0, 0.1, 1.5]),
    }
    walk = {name: trajectory(times_s, one @ turn.T) for name, one in points.items()}
    found = along_path(grid_s(times_s), walk)
    assert np.ptp(found[:, 0, 0]) == pytest.approx(2.9, abs=0.02)
    assert found[:, 1, 1] - found[:, 2, 1] == pytest.approx(np.full(30, 0.2))
    assert found[:, 1:, 2] == pytest.approx(np.full((30, 2), 0.1))


def test_landing_finds_the_nearest_true_step_once() -> None:
    falls = [Footfall(1.0, 0, np.zeros(2)), Footfall(1.5, 1, np.zeros(2))]
    begun = [Footfall(0.2, 1, np.zeros(2))]
    landed = [(0.1, "right"), (1.1, "right"), (1.25, "left"), (3.0, "left")]
    # The landing at 0.1 s began before the first frame; the one at 3.0 s is invented.
    assert matched(landed, falls, begun) == ({0, 1}, 1, 2)  # type: ignore[arg-type]


def test_landings_outside_the_counted_frames_are_neither_found_nor_invented() -> None:
    known = StepsByEye("A", "judge", ((10.0, 20.0),), (StepByEye(12.0, "left"),))
    one = counts(known, [(12.5, "left"), (16.0, "right"), (30.0, "left")])
    assert (one.found, one.invented, one.published) == (1, 1, 2)
