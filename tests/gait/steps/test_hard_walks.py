"""Walks that are hard to measure: cut off, standing, sitting down, half in view."""

import numpy as np
import pytest

from people4d.messages import F64, GaitMeasures
from services.gait.config import StepConfig
from services.gait.steps.step_meter import PointSample, StepMeter
from services.gait.steps.steps import find_steps, gait_measures
from tests.gait.steps import test_steps as walks
from tests.gait.steps.test_steps import NOISE_M2, feet

CONFIG = StepConfig()
NOISE_M = 0.03


def measured(times_s: F64, left: F64, right: F64) -> GaitMeasures:
    return walks.measured(left, right, times_s)


@pytest.mark.parametrize("begin_s", [0.1, 0.25, 0.4, 0.6, 0.85])
def test_recording_that_starts_within_a_step(begin_s: float) -> None:
    times_s = np.arange(0, 6, 1 / 30)
    found = measured(times_s, *feet(times_s + begin_s))
    assert found.step_length_m == pytest.approx(0.6, abs=0.02)
    assert found.cadence_per_min == pytest.approx(120, rel=0.03)


def test_person_who_only_stands_has_no_step() -> None:
    generator, times_s = np.random.default_rng(1), np.arange(0, 60, 1 / 15)
    meter = StepMeter(CONFIG)
    for time_s in times_s.tolist():
        points = np.array([[2.0, 0.1, 0.05], [2.0, -0.1, 0.05]])
        points += generator.normal(0, NOISE_M, points.shape)
        samples = (PointSample(one, NOISE_M2) for one in (points.mean(axis=0), *points))
        assert meter.add_frame(time_s, *samples).steps == 0


def test_feet_drawn_back_on_sitting_down_are_no_steps() -> None:
    # Both feet slide 15 cm back, one after the other, and stay there.
    times_s = np.arange(0, 8, 1 / 15)
    slides = [0.15 * np.clip((times_s - begin_s) / 0.4, 0, 1) for begin_s in (3.0, 3.3)]
    left, right = (
        np.stack([2.0 - slide, np.full_like(slide, aside), 0 * slide], axis=1)
        for slide, aside in zip(slides, (0.1, -0.1), strict=True)
    )
    assert measured(times_s, left, right) == GaitMeasures()


def test_person_half_in_view_for_minutes() -> None:
    # Only the left foot is in the image: it has correct measures or none.
    times_s = np.arange(0, 120, 1 / 15)
    left, right = feet(times_s)
    meter = StepMeter(CONFIG)
    for time_s, *points in zip(times_s.tolist(), (left + right) / 2, left, strict=True):
        body, foot = (PointSample(point, NOISE_M2) for point in points)
        found = meter.add_frame(time_s, body, foot, None)
        assert found.cadence_per_min in (None, pytest.approx(120, rel=0.05))
    assert len(meter.steps()) < 20


def test_two_people_in_step_have_the_same_measures() -> None:
    times_s = np.arange(0, 6, 1 / 30)
    left, right = feet(times_s)
    apart = np.array([0.0, 0.5, 0.0])
    assert measured(times_s, left, right) == measured(times_s, left + apart, right + apart)


def test_hesitation_in_a_step_leaves_the_cadence() -> None:
    # Both feet stand for 0.4 s after every fourth step, as where a person turns.
    times_s = np.arange(0, 12, 1 / 30)
    cycle_s = 2.4
    walked_s = times_s // cycle_s * 2.0 + np.minimum(times_s % cycle_s, 2.0)
    found = measured(times_s, *feet(walked_s))
    assert found.cadence_per_min == pytest.approx(120, rel=0.03)


@pytest.mark.parametrize("rate_hz", [5, 30])
def test_slow_walk_in_circles_with_the_head_ahead_of_the_feet(rate_hz: int) -> None:
    # Steps of 0.45 m in 0.9 s on a circle of 1 m.
    times_s = np.arange(0, 12, 1 / rate_hz)
    left, right = feet(times_s, 0.9, 0.9, step_m=0.45)
    head = (left + right) / 2 + (0.3, 0.0, 0.0)
    one, other, body = (
        walks.trajectory(times_s, bent(points, 1.0)) for points in (left, right, head)
    )
    found = gait_measures(find_steps(body, one, other))
    assert found.steps in (12, 13)
    assert found.cadence_per_min == pytest.approx(60 / 0.9, rel=0.03)


def bent(points_m: F64, radius_m: float) -> F64:
    """Return points beside the x axis beside a circle, at the same distances to its left."""
    angle, inner_m = points_m[:, 0] / radius_m, radius_m - points_m[:, 1]
    return np.stack([inner_m * np.sin(angle), -inner_m * np.cos(angle), points_m[:, 2]], axis=1)
