"""The Kalman filter of one point, by hand."""

import numpy as np
import pytest

from services.gait.points.kalman import PointKalmanFilter

NOISE_M2 = 0.01 * np.eye(3)


def still() -> PointKalmanFilter:
    """At the origin with sigma 0.1 m, velocity with sigma 1 m/s, no acceleration."""
    return PointKalmanFilter(np.zeros(3), NOISE_M2, 1.0, 0.0)


def test_prediction_and_correction_as_by_hand() -> None:
    # After 1 s: variance 0.01 + 1 of the position, covariance with the velocity 1.
    motion = still()
    motion.predict(1.0)
    assert motion.sigma_m == pytest.approx(1.01**0.5)
    # Then 1 m is measured with variance 0.01: gains 1.01 / 1.02 and 1 / 1.02.
    motion.correct(np.array([1.0, 0.0, 0.0]), NOISE_M2)
    assert motion.state == pytest.approx([1.01 / 1.02, 0, 0, 1 / 1.02, 0, 0])
    assert motion.covariance[0, 0] == pytest.approx(1.01 * 0.01 / 1.02)


def test_acceleration_spreads_a_prediction() -> None:
    # 2 m/s^2 over 0.5 s: 0.25 m of position, 1 m/s of velocity.
    motion = PointKalmanFilter(np.zeros(3), 0 * NOISE_M2, 0.0, 2.0)
    motion.predict(0.5)
    assert motion.sigma_m == pytest.approx(0.25)
    assert motion.covariance[3, 3] == pytest.approx(1.0)


def test_predicted_does_not_change_the_state() -> None:
    motion = still()
    motion.state[3] = 2.0
    state, _ = motion.predicted(0.5)
    assert state[0] == pytest.approx(1.0)
    assert motion.position_m == pytest.approx(np.zeros(3))


def test_distances_are_in_standard_deviations() -> None:
    # Variance 0.01 of the point and 0.01 of what is measured: 0.2 m is sqrt(0.04 / 0.02) of them.
    squares = still().distances2(np.array([[0.0, 0.2, 0.0], [0.0, 0.0, 0.0]]), NOISE_M2)
    assert squares == pytest.approx([2.0, 0.0])


def test_prediction_is_that_of_the_matrices() -> None:
    # F P F' + G G' q of the book, of a covariance that is not symmetric between the axes.
    motion = PointKalmanFilter(np.zeros(3), np.diag([0.01, 0.02, 0.03]), 1.0, 2.0)
    motion.predict(0.1)
    motion.correct(np.array([0.1, 0.0, 0.0]), np.diag([0.03, 0.01, 0.02]))
    F, G = np.eye(6), np.zeros((6, 3))
    F[:3, 3:] = 0.2 * np.eye(3)
    G[:3], G[3:] = 0.2**2 / 2 * np.eye(3), 0.2 * np.eye(3)
    state, covariance = motion.predicted(0.2)
    assert state == pytest.approx(F @ motion.state)
    np.testing.assert_allclose(covariance, F @ motion.covariance @ F.T + 4.0 * G @ G.T, atol=1e-12)


def test_covariances_stay_symmetric() -> None:
    # Asymmetry from rounding must not grow until positions are wrong.
    motion = PointKalmanFilter(np.array([0.3, 0.7, 3.0]), NOISE_M2, 1.5, 12.0)
    noise_m2 = np.array([[2.5, -0.5, -3.1], [-0.5, 3.5, 7.5], [-3.1, 7.5, 46.0]]) * 1e-4
    for _ in range(1000):
        motion.predict(1 / 30)
        motion.correct(np.array([0.3, 0.7, 3.0]), noise_m2)
    np.testing.assert_allclose(motion.covariance, motion.covariance.T, atol=1e-12)
    assert np.linalg.eigvalsh(motion.covariance).min() > 0


def test_damping_moves_the_velocity_by_a_ratio() -> None:
    motion = still()
    motion.state[3:] = (3.0, 0.0, 0.0)
    motion.damp_velocity(np.array([1.0, 0.0, 2.0]), 0.5)
    assert motion.state == pytest.approx([0, 0, 0, 2.0, 0.0, 1.0])
