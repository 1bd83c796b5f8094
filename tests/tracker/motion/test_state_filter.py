"""Decay of the velocity of unmatched tracks."""

import math

import numpy as np
import pytest

from services.tracker.motion.state_filter import decay_velocity


def test_velocity_decays_and_its_variance_recovers() -> None:
    # dt = tau ln 2: k = 1/2. v: 1 -> 0.5; its variance 0.04 -> 0.25 * 0.04 + 0.75 * 0.36 = 0.28;
    # its covariance with the position 0.02 -> 0.01; up and down only 0.25 * 0.04 = 0.01.
    x = np.array([[3, 0, 1, 1, 0, 0.0]] * 2)
    P = np.array([0.04 * np.eye(6)] * 2)
    P[:, 0, 3] = P[:, 3, 0] = 0.02
    after, covariance = decay_velocity(x, P, np.array([True, False]), 0.7 * math.log(2))
    expected = np.array([[3, 0, 1, 0.5, 0, 0], [3, 0, 1, 1, 0, 0.0]])
    np.testing.assert_allclose(after, expected)
    np.testing.assert_allclose(np.diag(covariance[0]), [0.04, 0.04, 0.04, 0.28, 0.28, 0.01])
    assert covariance[0, 0, 3] == pytest.approx(0.01)
    np.testing.assert_array_equal(covariance[1], P[1])
