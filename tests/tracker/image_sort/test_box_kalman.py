"""The filter of a box, by hand and against the general one of seven states."""

import numpy as np
import pytest

from common import kalman
from people4d.messages import F64
from services.tracker.image_sort import box_kalman
from services.tracker.image_sort.box_kalman import TRACK


def begun(*box: float) -> np.void:
    track: np.void = np.zeros(1, TRACK)[0]
    box_kalman.begin(track, np.array(box))
    return track


def test_a_box_is_centre_area_and_aspect() -> None:
    # 20 wide and 40 high: centre (20, 40), area 800, aspect 0.5.
    assert list(begun(10, 20, 30, 60)["x"]) == [20, 40, 800, 0.5]


def test_prediction_and_correction_by_hand() -> None:
    # One axis of u. Start: position variance 10, velocity variance 10^4.
    # Predicted by one frame: 10 + 10^4 + 1 = 10011, covariance 10^4, velocity 10^4 + 0.01.
    track = begun(10, 20, 30, 60)
    box_kalman.predict(track)
    assert (track["pp"][0], track["pv"][0]) == (10011, 10000)
    assert track["vv"][0] == pytest.approx(10000.01)
    # Measured 5 px to the right, R = 1: K = 10011/10012 and 10000/10012.
    box_kalman.correct(track, np.array([15.0, 20, 35, 60]))
    assert track["x"][0] == pytest.approx(20 + 5 * 10011 / 10012)
    assert track["v"][0] == pytest.approx(5 * 10000 / 10012)


def test_the_box_is_that_of_the_state() -> None:
    track = begun(10, 20, 30, 60)
    np.testing.assert_allclose(track["box"], [10, 20, 30, 60])


def test_an_area_that_would_vanish_stops_shrinking() -> None:
    # 800 px^2 less 500 a frame: the second frame would have none.
    track = begun(10, 20, 30, 60)
    track["v"][2] = -500.0
    areas = []
    for _ in range(3):
        box_kalman.predict(track)
        areas.append(track["x"][2])
    assert areas == [300, 300, 300]


def full(track: np.void) -> tuple[F64, F64]:
    """Return state and covariance of the filter of seven states."""
    P = np.diag(np.concatenate([track["pp"], track["vv"]]))
    P[range(3), range(4, 7)] = P[range(4, 7), range(3)] = track["pv"]
    return np.concatenate([track["x"], track["v"]]), P


def test_equals_the_filter_of_seven_states() -> None:
    # SORT's matrices: F adds velocity to u, v, s; R, Q and the first P as published.
    F = np.eye(7)
    F[range(3), range(4, 7)] = 1.0
    Q, R = np.diag([1, 1, 1, 1, 0.01, 0.01, 0.0001]), np.diag([1.0, 1, 10, 10])
    rng, box = np.random.default_rng(5), np.array([100.0, 50, 160, 200])
    track = begun(*box)
    x, P = full(track)
    np.testing.assert_array_equal(P, np.diag([10, 10, 10, 10, 1e4, 1e4, 1e4]))
    for _ in range(20):
        box = box + rng.normal([4.0, 1.0, 4.5, 1.2], 1.0)
        x, P = kalman.predict(x, P, F, Q)
        box_kalman.predict(track)
        width, height = box[2:] - box[:2]
        z = np.array([*(box[:2] + box[2:]) / 2, width * height, width / height])
        x, P = kalman.update(x, P, z, R)
        box_kalman.correct(track, box)
        for ours, general in zip(full(track), (x, P), strict=True):
            np.testing.assert_allclose(ours, general, rtol=1e-6, atol=1e-6)
