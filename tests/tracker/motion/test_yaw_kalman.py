"""Yaw by a Kalman filter: by hand, and for any person of a stack."""

import math

import numpy as np
import pytest

from common.geometry.transforms import wrap
from people4d.messages import F64
from services.tracker.interface import Measurement
from services.tracker.motion.yaw_kalman import KalmanYaw
from tests.tracker.scene import AT_REST, facing

FILTER = KalmanYaw()


def state(psi_rad: float, rate_radps: float = 0.0, variance: float = 0.25) -> F64:
    return np.array([psi_rad, rate_radps, variance, 0.0, 1.0])


def predict(before: F64, dt_s: float) -> F64:
    (after,) = FILTER.predict([before], dt_s)
    assert after is not None
    return after


def update(before: F64 | None, detected: Measurement) -> F64:
    (after,) = FILTER.update([before], [detected])
    assert after is not None
    return after


def test_the_first_measurement_begins_the_state() -> None:
    begun = update(None, facing(7.0))
    np.testing.assert_allclose(begun[:2], [7.0 - 2 * math.pi, 0.0])
    np.testing.assert_allclose(begun[2:5], [0.1225, 0.0, 1.0])
    assert FILTER.read(begun, AT_REST) == pytest.approx(7.0 - 2 * math.pi)
    assert FILTER.read(None, np.ones(3)) is None
    assert FILTER.update([None], [facing(None)]) == [None]


def test_prediction_by_hand() -> None:
    # psi = 1 + 0.1 * 0.5. P00 = 0.25 + 0.1^2 * 1 + 6^2 * 0.1^4 / 4 = 0.25 + 0.01 + 0.0009,
    # P01 = 0.1 * 1 + 36 * 0.1^3 / 2 = 0.118, P11 = 1 + 36 * 0.1^2 = 1.36.
    after = predict(state(1.0, 0.5), 0.1)
    np.testing.assert_allclose(after[:2], [1.05, 0.5])
    np.testing.assert_allclose(after[2:5], [0.2609, 0.118, 1.36])


def test_the_innovation_is_wrapped() -> None:
    # 175 deg, measured -175: 10 deg farther. P = R, so half of it: 180, not 0.
    after = update(state(math.radians(175), variance=0.1225), facing(math.radians(-175)))
    assert math.degrees(abs(after[0])) == pytest.approx(180.0)
    assert after[2] == pytest.approx(0.06125)  # P R / (P + R) = R / 2
    assert FILTER.read(after, AT_REST) == pytest.approx(math.pi)


def test_update_is_joseph_form() -> None:
    # (1 - K H) P (1 - K H)' + K R K' with H = [1 0], R = 0.35^2
    P, H, R = np.array([[0.3, 0.1], [0.1, 0.6]]), np.array([[1.0, 0.0]]), 0.1225
    K = P @ H.T / (P[0, 0] + R)
    expected = (np.eye(2) - K @ H) @ P @ (np.eye(2) - K @ H).T + R * K @ K.T
    after = update(np.array([0.2, 0.5, 0.3, 0.1, 0.6]), facing(0.4))
    np.testing.assert_allclose(after[:2], [0.2, 0.5] + 0.2 * K[:, 0])
    np.testing.assert_allclose(after[2:], [expected[0, 0], expected[0, 1], expected[1, 1]])


def test_the_prediction_is_wrapped() -> None:
    # 170 deg, then 1 rad/s for half a second: 170 + 28.6 = 198.6, which is -161.4.
    after = predict(state(math.radians(170), 1.0), 0.5)
    assert math.degrees(after[0]) == pytest.approx(170 + 28.648 - 360, abs=1e-3)


@pytest.mark.parametrize("turn_deg", [10, 90, 179, -135])
def test_turning_the_world_turns_the_yaw(turn_deg: float) -> None:
    rng = np.random.default_rng(3)
    turn = math.radians(turn_deg)
    one: F64 | None = None
    other: F64 | None = None
    for z in rng.normal(3.0, 0.6, 40):
        one = update(None if one is None else predict(one, 0.1), facing(z))
        other = None if other is None else predict(other, 0.1)
        other = update(other, facing(wrap(z + turn)))
        assert wrap(other[0] - one[0] - turn) == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(other[2:5], one[2:5])


def test_a_steady_turn_is_followed_through_180_deg() -> None:
    turned = update(None, facing(2.0))
    for step in range(1, 60):  # 1 rad/s at 30 Hz: from 2 rad through pi to 3.97 rad
        turned = update(predict(turned, 1 / 30), facing(wrap(2.0 + step / 30)))
    assert wrap(turned[0] - (2.0 + 59 / 30)) == pytest.approx(0.0, abs=math.radians(1))
    assert turned[1] == pytest.approx(1.0, abs=0.05)


def test_two_seconds_without_a_measurement() -> None:
    # P00 = 0.25 + 2^2 * 1 + 36 * 2^4 / 4 = 148.25: nothing is known, but nothing overflows.
    gone = predict(state(0.1, 0.2), 2.0)
    assert gone[2] == pytest.approx(148.25)
    for _ in range(1000):
        gone = predict(gone, 2.0)
    assert np.isfinite(gone).all()
    assert abs(gone[0]) <= math.pi
    # The next measurement is accepted at once: K = 1 within 1e-9.
    assert update(gone, facing(-2.0))[0] == pytest.approx(-2.0)


def test_a_measurement_that_is_no_number_is_refused() -> None:
    before = state(0.3)
    detected = [facing(math.nan), facing(math.inf)]
    after = FILTER.update([before, None], detected)
    assert after[0] is before
    assert after[1] is None


def test_people_in_a_stack_do_not_mix() -> None:
    crowd = [state(0.1), None, state(3.0, -1.0), None]
    detected = [facing(0.5), facing(None), facing(None), facing(-1.0)]
    after = FILTER.update(crowd, detected)
    assert after[1] is None
    assert after[2] is crowd[2]
    assert after[0] is not None
    assert after[3] is not None
    np.testing.assert_allclose(after[0][:2], update(state(0.1), detected[0])[:2])
    np.testing.assert_allclose(after[3][:2], [-1.0, 0.0])
    assert FILTER.predict([None, None], 0.1) == [None, None]
