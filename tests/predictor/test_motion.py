"""Motion models of the predictor."""

import numpy as np
import pytest

from services.predictor import motion as motion_models
from services.predictor.motion import (
    ACCELERATIONS,
    POSITION,
    SIGMA_FIRST_MPS,
    STANDING,
    STRAIGHT,
    VELOCITY,
    initial_motion,
    predict_motion,
    update_motion,
)
from services.predictor.motion_filter import NOISE_FACTOR, MotionFilter, TrackedMotion

STEP_S = 0.4
UNKNOWN_MPS = 300.0


def tracked(positions: list[list[float]], ids: list[int] | None = None) -> TrackedMotion:
    """Build positions of people with unknown velocities."""
    count = len(positions)
    return TrackedMotion(
        np.array(ids or range(1, count + 1), np.int64),
        np.array(positions, float).reshape(-1, 2),
        np.full(count, 1e-3),
        np.zeros((count, 2)),
        np.full(count, UNKNOWN_MPS),
    )


def test_velocity_and_mode_follow_from_positions() -> None:
    filter_ = MotionFilter()
    for number in range(20):
        now_s = number * STEP_S
        motion, *_ = filter_.add_tracks(now_s, tracked([[1.2 * now_s, 0.0], [5.0, 5.0]]))
    np.testing.assert_allclose(motion.velocity_mps, [[1.2, 0.0], [0.0, 0.0]], atol=0.01)
    assert motion.modes[0].argmax() == STRAIGHT
    assert motion.modes[1].argmax() == STANDING


def test_positions_between_two_samples_do_not_count_twice() -> None:
    # Four messages give the same estimate as one.
    often, seldom = MotionFilter(), MotionFilter()
    for number in range(25):
        now_s = number * 0.1
        message = tracked([[1.0 * now_s, 0.0]])
        one, *_ = often.add_tracks(now_s, message)
        if number % 4 == 0:
            other, *_ = seldom.add_tracks(now_s, message)
    np.testing.assert_allclose(one.covariances, other.covariances)
    np.testing.assert_allclose(one.velocity_mps, other.velocity_mps)


@pytest.mark.parametrize("jitter_m", [0.006, 0.03])
def test_noise_of_positions_is_learned_from_their_jitter(jitter_m: float) -> None:
    rng = np.random.default_rng(1)
    filter_ = MotionFilter()
    for number in range(150):
        now_s = number * STEP_S
        path = np.array([[1.2 * now_s, 0.0], [0.0, 1.2 * now_s]])
        filter_.add_tracks(now_s, tracked((path + rng.normal(0, jitter_m, (2, 2))).tolist()))
    assert filter_.sigma_m == pytest.approx(NOISE_FACTOR * jitter_m, rel=0.4)


def test_person_absent_for_long_has_a_new_state() -> None:
    filter_ = MotionFilter()
    for number in range(10):
        filter_.add_tracks(number * STEP_S, tracked([[number * 0.4, 0.0]], [7]))
    again, *_ = filter_.add_tracks(5.0, tracked([[5.0, 0.0]], [7]))
    assert again.velocity_mps[0, 0] == pytest.approx(1.0, abs=0.05)
    filter_.add_tracks(8.0, tracked([[0.0, 0.0]], [8]))
    new, *_ = filter_.add_tracks(8.1, tracked([[9.0, 0.0], [0.0, 0.0]], [7, 8]))
    np.testing.assert_array_equal(new.velocity_mps[0], [0.0, 0.0])


def test_prediction_without_measurement_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    # Constant velocity over 2 s with q: p + 2 v; var p = P_pp + 4 P_vv + q 8/3.
    monkeypatch.setattr(motion_models, "CHANGE_RATES_HZ", np.zeros((3, 3)))
    monkeypatch.setattr(motion_models, "DECAYS_S", (1.3, 1e6, 1e6))
    motion = initial_motion(np.array([[1.0, 2.0]]), np.array([0.1]))
    motion.states[..., VELOCITY] = [0.5, -0.5]
    after = predict_motion(motion, np.array([2.0]))
    np.testing.assert_allclose(after.states[0, STRAIGHT, :, POSITION], [2.0, 1.0], atol=1e-5)
    expected = 0.1**2 + 4 * SIGMA_FIRST_MPS**2 + ACCELERATIONS[STRAIGHT] ** 2 * 8 / 3
    assert after.covariances[0, STRAIGHT, 0, 0] == pytest.approx(expected, rel=1e-5)


def test_mode_changes_by_hand() -> None:
    # A standing person leaves that mode at 0.06 per second: exp(-0.06) = 0.941765 after 1 s, and
    # the rest is divided equally.
    motion = initial_motion(np.zeros((1, 2)), np.ones(1))
    motion.modes[:] = [1.0, 0.0, 0.0]
    after = predict_motion(motion, np.ones(1))
    np.testing.assert_allclose(after.modes[0], [0.941765, 0.029118, 0.029118], atol=1e-6)


def test_measurement_by_hand() -> None:
    # Variance 1 and a measurement of variance 1 at distance 2: halfway, variance 1/2.
    motion = initial_motion(np.array([[0.0, 0.0]]), np.array([1.0]))
    after = update_motion(motion, POSITION, np.array([[2.0, 0.0]]), np.array([1.0]))
    np.testing.assert_allclose(after.states[0, ..., POSITION], [[1.0, 0.0]] * 3)
    np.testing.assert_allclose(after.covariances[0, :, 0, 0], 0.5)
    assert after.modes.sum() == pytest.approx(1.0)
