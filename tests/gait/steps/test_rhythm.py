"""Rhythm of a walk whose cadence is known."""

import numpy as np
import pytest

from people4d.messages import F64
from services.gait.steps.rhythm import Oscillation, feet_distance, head_height, with_rhythm
from services.gait.steps.swings import FootTrajectory

UP = np.array([0.0, 0.0, 1.0])
STEP_S = 0.5


def walk(times_s: F64, noise_m: float = 0.0, swing_m: float = 0.3) -> Oscillation:
    """Return the distance of feet that are farthest apart at each landing, every 0.5 s."""
    noise = np.random.default_rng(1).normal(0, 1, len(times_s)) * noise_m
    distance_m = 0.4 + swing_m * np.cos(2 * np.pi * times_s / STEP_S) + noise
    return Oscillation(times_s, distance_m, np.full(len(times_s), 0.05**2 + noise_m**2))


def test_distance_of_feet_is_level_and_at_common_times() -> None:
    times_s = np.array([0.0, 0.1, 0.2])
    noises_m2 = np.tile(0.03**2 * np.eye(3), (3, 1, 1))
    left = FootTrajectory(times_s, np.array([[0, 0, 0.0], [0.3, 0, 0.1], [0.3, 0.4, 0]]), noises_m2)
    right = FootTrajectory(times_s[1:], np.zeros((2, 3)), noises_m2[1:])
    found = feet_distance(left, right, UP)
    assert found.times_s.tolist() == [0.1, 0.2]
    assert found.values_m == pytest.approx([0.3, 0.5])
    # Twice the variance of a foot, and 0.05 m.
    assert found.variances_m2 == pytest.approx(2 * 0.03**2 + 0.05**2)


@pytest.mark.parametrize("rate_hz", [10, 15, 30])
@pytest.mark.parametrize("off", [-0.08, 0.0, 0.08])
def test_landings_that_are_off_are_corrected(off: float, rate_hz: int) -> None:
    feet = walk(np.arange(0, 8, 1 / rate_hz), noise_m=0.05)
    step_s = STEP_S * (1 + off)
    assert with_rhythm(step_s, 0.05, [feet]) == pytest.approx(STEP_S, rel=0.015)


def test_landings_that_are_certain_hardly_change() -> None:
    feet = walk(np.arange(0, 8, 1 / 30), noise_m=0.05)
    assert with_rhythm(0.52, 1e-4, [feet]) == pytest.approx(0.52, rel=0.002)


@pytest.mark.parametrize(
    ("times_s", "swing_m"),
    [(np.arange(0, 8, 1 / 30), 0.0), (np.arange(0, 0.3, 1 / 30), 0.3), (np.empty(0), 0.3)],
    ids=["standing", "short", "empty"],
)
def test_without_a_rhythm_landings_count(times_s: F64, swing_m: float) -> None:
    assert with_rhythm(0.54, 0.05, [walk(times_s, 0.03, swing_m)]) == 0.54


def test_rhythm_far_from_the_landings_does_not_count() -> None:
    """It may come from strides, shadows, or a turn."""
    feet = walk(np.arange(0, 8, 1 / 30))
    assert with_rhythm(0.7, 0.05, [feet]) == 0.7


def test_head_gives_the_rhythm_while_feet_are_hidden() -> None:
    times_s = np.arange(0, 8, 1 / 20)
    points_m = np.zeros((len(times_s), 3))
    points_m[:, 2] = 1.6 - 0.02 * np.cos(2 * np.pi * times_s / STEP_S)
    head = head_height(times_s, points_m, UP)
    assert with_rhythm(0.54, 0.05, [walk(np.empty(0)), head]) == pytest.approx(STEP_S, rel=0.015)
