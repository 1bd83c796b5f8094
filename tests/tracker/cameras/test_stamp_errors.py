"""Errors of stamps by people in view of two cameras."""

import numpy as np
import pytest

from people4d.messages import F64
from services.tracker.cameras.stamp_errors import SAMPLES_MIN, Walked, stamp_errors

COUNT = 100


def path_m(t_s: F64) -> F64:
    """Positions (Nx3) of a person walking back and forth, from a camera at the origin."""
    return np.stack([1.5 * np.sin(0.7 * t_s), 3.5 + np.sin(0.45 * t_s), np.ones(len(t_s))], axis=1)


def walked(
    ahead_s: float, turn_rad: float = 0.0, seed: int = 0, others: int = 0, count: int = COUNT
) -> Walked:
    """Samples with stamps of the first camera ahead by `ahead_s`, and its pose turned."""
    rng = np.random.default_rng(seed)
    t_s = np.linspace(0.0, 0.2 * count, count)
    between_s: F64 = rng.uniform(-0.1, 0.1, count)
    velocity = (path_m(t_s + 0.05) - path_m(t_s - 0.05)) / 0.1
    ray = path_m(t_s)
    first = path_m(t_s - ahead_s) + turn_rad * np.stack(
        [-ray[:, 1], ray[:, 0], np.zeros(count)], axis=1
    )
    second = path_m(t_s - between_s)
    apart = first - second + rng.normal(0, 0.05, (count, 3))
    apart[:others] = rng.uniform(-1, 1, (others, 3))
    return Walked(apart, ray, velocity, between_s)


@pytest.mark.parametrize("ahead_s", [-0.3, -0.1, 0.0, 0.05, 0.2])
@pytest.mark.parametrize("turn_rad", [0.0, 0.087])
def test_error_of_a_camera_is_found_though_its_pose_is_wrong(
    ahead_s: float, turn_rad: float
) -> None:
    errors = [
        stamp_errors({("a", "b"): walked(ahead_s, turn_rad, seed)}, "b")["a"] for seed in range(20)
    ]
    found = np.array([error.ahead_s for error in errors])
    np.testing.assert_allclose(found.mean(), ahead_s, atol=0.02)
    within = np.abs(found - ahead_s) < 3 * np.array([error.sigma_s for error in errors])
    assert within.all()


def test_error_of_a_camera_is_found_through_another() -> None:
    pairs = {("a", "b"): walked(0.1), ("b", "c"): walked(0.15)}
    found = stamp_errors(pairs, "a")
    assert found["b"].ahead_s == pytest.approx(-0.1, abs=0.03)
    assert found["c"].ahead_s == pytest.approx(-0.25, abs=0.04)
    assert found["c"].sigma_s > found["b"].sigma_s


def test_confused_people_change_the_error_little() -> None:
    found = stamp_errors({("a", "b"): walked(0.1, others=15)}, "b")["a"]
    assert found.ahead_s == pytest.approx(0.1, abs=0.03)


def test_few_or_standing_people_give_no_error() -> None:
    few = walked(0.1, count=SAMPLES_MIN - 1)
    still = walked(0.1)._replace(velocity_mps=np.zeros((COUNT, 3)))
    unknown = walked(0.1)._replace(velocity_mps=np.full((COUNT, 3), np.nan))
    for people in (few, still, unknown):
        assert stamp_errors({("a", "b"): people}, "b") == {}


def test_walking_in_one_direction_gives_no_significant_error() -> None:
    people = walked(0.1)
    t_s = np.arange(COUNT) * 0.2
    velocity = np.tile((1.0, 0.0, 0.0), (COUNT, 1))
    ray = np.stack([t_s % 4 - 2, np.full(COUNT, 3.5), np.ones(COUNT)], axis=1)
    apart = -0.1 * velocity
    straight = people._replace(
        apart_m=apart, ray_m=ray, velocity_mps=velocity, between_s=np.zeros(COUNT)
    )
    found = stamp_errors({("a", "b"): straight}, "b")["a"]
    assert abs(found.ahead_s) < 3 * found.sigma_s
