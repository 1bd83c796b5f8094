import math

import numpy as np
import pytest

from services.detector.position.certainty import (
    CertaintyRule,
    along_m2,
    axis_sigma,
    covariance,
    joint_m,
)
from services.detector.position.trunk import TrunkRule
from tests.detector.cameras import INFO

RULE = CertaintyRule(depth_per_m=0.004, body_m=0.03, joint_m=0.03, joint_px=2.0)


def test_one_reading_errs_with_the_square_of_the_distance() -> None:
    # 1 m: 0.004; 2 m: 0.016; 4 m: 0.064 m, each with 0.03 m of the body.
    for z_m, sensor_m in ((1.0, 0.004), (2.0, 0.016), (4.0, 0.064)):
        expected_m2 = sensor_m**2 + 0.03**2
        assert along_m2(z_m, np.array([z_m]), 0.0, RULE) == pytest.approx(expected_m2)


def test_several_readings_are_surer_and_their_spread_counts() -> None:
    # Four at 2 m: 0.016^2 / 4. 1.9, 2.1, 1.9, 2.1: variance 4 * 0.01 / 3, of the mean a quarter.
    alike = along_m2(2.0, np.full(4, 2.0), 0.0, RULE)
    spread = along_m2(2.0, np.array([1.9, 2.1, 1.9, 2.1]), 0.0, RULE)
    assert alike == pytest.approx(0.016**2 / 4 + 0.03**2)
    assert spread - alike == pytest.approx(0.01 / 3)


def test_what_all_readings_share_does_not_shrink() -> None:
    readings_m = np.full(4, 2.0)
    more = along_m2(2.0, readings_m, 0.05, RULE) - along_m2(2.0, readings_m, 0.0, RULE)
    assert more == pytest.approx(0.05**2)


def test_a_joint_of_a_far_person_is_a_matter_of_pixels() -> None:
    # 2 px at fx = 50: 0.04 m per metre; at 1 m with 0.03 m: 0.05 m.
    assert joint_m(1.0, INFO, RULE) == pytest.approx(0.05)
    assert joint_m(100.0, INFO, RULE) == pytest.approx(4.0, rel=1e-3)


def test_the_axis_is_unsure_where_the_way_faced_or_the_body_is_unknown() -> None:
    trunk = TrunkRule(half_depth_m=0.12, half_width_m=0.2)
    assert axis_sigma(trunk, 1.0, RULE) == 0.0
    assert axis_sigma(trunk, None, RULE) == pytest.approx(0.08 / math.sqrt(8))
    assert axis_sigma(None, 1.0, RULE) == RULE.surface_m


def test_covariance_of_a_person_straight_ahead() -> None:
    ahead = covariance(np.array([0.0, 0.0, 2.0]), 0.01, 0.02, 0.09)
    np.testing.assert_allclose(ahead, np.diag([0.01, 0.02, 0.09]), atol=1e-15)


def test_covariance_of_a_person_to_the_right() -> None:
    # The line of sight is (0.6, 0, 0.8), across it is (0.8, 0, -0.6):
    # xx = 0.64 * 0.01 + 0.36 * 0.09 = 0.0388, zz = 0.36 * 0.01 + 0.64 * 0.09 = 0.0612,
    # xz = 0.48 (0.09 - 0.01) = 0.0384.
    aside = covariance(np.array([3.0, 0.0, 4.0]), 0.01, 0.02, 0.09)
    expected = [[0.0388, 0.0, 0.0384], [0.0, 0.02, 0.0], [0.0384, 0.0, 0.0612]]
    np.testing.assert_allclose(aside, expected, atol=1e-15)


def test_a_covariance_is_symmetric_to_the_last_bit_and_positive() -> None:
    rng = np.random.default_rng(3)
    for position_m in rng.uniform((-3, -2, 0.3), (3, 2, 5), (50, 3)):
        found = covariance(position_m, *rng.uniform(1e-4, 0.1, 3))
        assert (found == found.T).all()
        assert np.linalg.eigvalsh(found)[0] > 0


def test_numbers_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="body_m: expected a number > 0, got 0"):
        CertaintyRule(body_m=0)
