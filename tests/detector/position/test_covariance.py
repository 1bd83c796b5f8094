import math

import numpy as np
import pytest

from services.detector.position.axis import (
    BODY_M,
    SURFACE_M,
    Ellipse,
    axis_sigma,
    covariance,
    variance_along,
)

DEPTH_PER_M = 0.004


def test_one_reading_errs_with_the_square_of_the_distance() -> None:
    # 1 m: 0.004; 2 m: 0.016; 4 m: 0.064 m, each with the body's 0.035 m.
    assert BODY_M == 0.035
    for z_m, sensor_m in ((1.0, 0.004), (2.0, 0.016), (4.0, 0.064)):
        expected_m2 = sensor_m**2 + 0.035**2
        assert variance_along(z_m, [z_m], 0.0, DEPTH_PER_M) == pytest.approx(expected_m2)


def test_several_readings_have_less_variance_but_for_their_spread() -> None:
    # Four at 2 m: 0.016^2 / 4. 1.9, 2.1, 1.9, 2.1: variance 4 * 0.01 / 3, of the mean a quarter.
    alike = variance_along(2.0, [2.0] * 4, 0.0, DEPTH_PER_M)
    spread = variance_along(2.0, [1.9, 2.1, 1.9, 2.1], 0.0, DEPTH_PER_M)
    assert alike == pytest.approx(0.016**2 / 4 + 0.035**2)
    assert spread - alike == pytest.approx(0.01 / 3)


def test_a_common_error_does_not_shrink() -> None:
    readings_m = [2.0] * 4
    more, less = (variance_along(2.0, readings_m, sigma_m, DEPTH_PER_M) for sigma_m in (0.05, 0.0))
    assert more - less == pytest.approx(0.05**2)


def test_axis_is_uncertain_if_yaw_or_body_is_unknown() -> None:
    ellipse = Ellipse(half_depth_m=0.12, half_width_m=0.2)
    assert axis_sigma(ellipse, 1.0) == 0.0
    assert axis_sigma(ellipse, None) == pytest.approx(0.08 / math.sqrt(8))
    assert axis_sigma(None, 1.0) == SURFACE_M


def test_covariance_of_a_person_straight_ahead() -> None:
    ahead = covariance([0.0, 0.0, 2.0], 0.01, 0.02, 0.09)
    np.testing.assert_allclose(ahead, np.diag([0.01, 0.02, 0.09]), atol=1e-15)


def test_covariance_of_a_person_to_the_right() -> None:
    # The line of sight is (0.6, 0, 0.8), across it is (0.8, 0, -0.6):
    # xx = 0.64 * 0.01 + 0.36 * 0.09 = 0.0388, zz = 0.36 * 0.01 + 0.64 * 0.09 = 0.0612,
    # xz = 0.48 (0.09 - 0.01) = 0.0384.
    aside = covariance([3.0, 0.0, 4.0], 0.01, 0.02, 0.09)
    expected = [[0.0388, 0.0, 0.0384], [0.0, 0.02, 0.0], [0.0384, 0.0, 0.0612]]
    np.testing.assert_allclose(aside, expected, atol=1e-15)


def test_a_covariance_is_symmetric_to_the_last_bit_and_positive() -> None:
    rng = np.random.default_rng(3)
    for position_m in rng.uniform((-3, -2, 0.3), (3, 2, 5), (50, 3)):
        found = covariance(position_m.tolist(), *rng.uniform(1e-4, 0.1, 3))
        assert (found == found.T).all()
        assert np.linalg.eigvalsh(found)[0] > 0
