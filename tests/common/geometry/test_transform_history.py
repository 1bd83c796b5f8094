"""Transform over time: interpolation, prediction, gaps, jumps and clock resets by hand."""

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.geometry.transform_history import TransformHistory, interpolate
from common.geometry.transforms import rotation_from_rpy, transform_from
from people4d.messages import F64


def pose(x_m: float, y_m: float = 0.0, yaw_rad: float = 0.0) -> F64:
    return transform_from((x_m, y_m, 0.0), rotation_from_rpy(0, 0, yaw_rad))


def ms(value: float) -> int:
    return round(value * 1e6)


def history(*samples: tuple[float, F64]) -> tuple[TransformHistory, Counter[str]]:
    counters: Counter[str] = Counter()
    made = TransformHistory(counters)
    for at_ms, matrix in samples:
        made.add_sample(ms(at_ms), matrix)
    return made, counters


def matrix_at(made: TransformHistory, at_ms: float) -> F64:
    estimate = made.at(ms(at_ms))
    assert estimate is not None
    return estimate.matrix


def test_interpolation_has_constant_velocity() -> None:
    # A quarter of the way from (0, 0), 170 deg to (1, 2), -170 deg: through 180, not through 0.
    made, _ = history((0, pose(0, 0, math.radians(170))), (100, pose(0.1, 0.2, math.radians(-170))))
    np.testing.assert_allclose(
        matrix_at(made, 25), pose(0.025, 0.05, math.radians(175)), atol=1e-12
    )
    estimate = made.at(ms(25))
    assert estimate is not None
    assert not estimate.is_uncertain


def test_transform_before_the_first_sample_is_none() -> None:
    made, _ = history((100, pose(1)))
    assert made.at(ms(99)) is None
    np.testing.assert_array_equal(matrix_at(made, 100), pose(1))


def test_extrapolation_continues_the_motion_for_half_a_second() -> None:
    # 1 m/s along x, a sample every 20 ms: 0.1 m after 100 ms, and at most 0.5 m.
    made, _ = history(*((t, pose(t / 1000)) for t in range(0, 201, 20)))
    np.testing.assert_allclose(matrix_at(made, 300), pose(0.3), atol=1e-12)
    np.testing.assert_allclose(matrix_at(made, 2000), pose(0.7), atol=1e-12)


def test_uncertainty_of_extrapolation_grows_with_time() -> None:
    # Half of 1 m/s^2 and of 2 rad/s^2 times 0.2 s squared: 0.02 m, 0.04 rad.
    made, _ = history((0, pose(0)), (50, pose(0)))
    estimate = made.at(ms(250))
    assert estimate is not None
    assert estimate.sigma_m == pytest.approx(0.02)
    assert estimate.sigma_rad == pytest.approx(0.04)


def test_interpolation_over_a_gap_is_uncertain() -> None:
    # 0.8 s between samples; 0.3 s from the nearer: half of 1 * 0.09 = 0.045 m.
    made, counters = history((0, pose(0)), (800, pose(0.8)))
    estimate = made.at(ms(500))
    assert estimate is not None
    np.testing.assert_allclose(estimate.matrix, pose(0.5), atol=1e-12)
    assert estimate.sigma_m == pytest.approx(0.045)
    assert counters["motion_gaps"] == 1


def test_reset_of_the_origin_does_not_move_the_base() -> None:
    # The odometry of a base at (2, 0) restarts at 0: the base is still at (2, 0), then at 2.1.
    made, counters = history(
        (0, pose(2)), (50, pose(2)), (100, pose(0)), (150, pose(0.1)), (200, pose(0.2))
    )
    np.testing.assert_allclose(matrix_at(made, 100), pose(2), atol=1e-12)
    np.testing.assert_allclose(matrix_at(made, 200), pose(2.2), atol=1e-12)
    assert counters["motion_jumps"] == 1


def test_duplicates_are_counted_and_late_samples_put_in_order() -> None:
    made, counters = history((0, pose(0)), (100, pose(0.1)), (100, pose(0.1)), (50, pose(0.08)))
    np.testing.assert_allclose(matrix_at(made, 75), pose(0.09), atol=1e-12)
    assert counters == {"motion_duplicates": 1, "motion_gaps": 0}


def test_clock_jump_back_restarts_the_history() -> None:
    made, counters = history((60_000, pose(9)), (0, pose(0)), (100, pose(0.1)))
    np.testing.assert_allclose(matrix_at(made, 50), pose(0.05), atol=1e-12)
    assert counters["motion_clock_resets"] == 1


def test_samples_older_than_five_seconds_are_dropped() -> None:
    made, _ = history((0, pose(0)), (400, pose(0)), (5500, pose(0)))
    assert made.at(ms(450)) is None
    assert made.at(ms(5500)) is not None


@given(st.floats(-3, 3), st.floats(-2, 2), st.floats(0, 1))
def test_interpolation_composes_to_the_end_transform(
    yaw_rad: float, far_m: float, fraction: float
) -> None:
    start, end = pose(1, 2, 0.5), pose(1 + far_m, 2 - far_m, 0.5 + yaw_rad)
    middle = interpolate(start, end, fraction)
    if fraction < 1:
        np.testing.assert_allclose(interpolate(middle, end, 1.0), end, atol=1e-9)
    # A constant turn: the middle is turned by its fraction.
    turned = math.atan2(middle[1, 0], middle[0, 0]) - 0.5
    assert math.cos(turned - fraction * yaw_rad) == pytest.approx(1.0, abs=1e-9)
