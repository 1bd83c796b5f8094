"""The filter against numbers worked on paper."""

import numpy as np
import pytest

from common import kalman

F = np.array([[1.0, 1.0], [0.0, 1.0]])  # dt = 1
R = np.array([[[1.0]]])


def test_predict_on_paper() -> None:
    # x = [0, 1], P = I: F x = [1, 1]; F I F' = [[1+1, 1], [1, 1]].
    x, P = kalman.predict(np.array([[0.0, 1.0]]), np.eye(2)[None], F, np.zeros((2, 2)))
    np.testing.assert_allclose(x, [[1.0, 1.0]])
    np.testing.assert_allclose(P, [[[2.0, 1.0], [1.0, 1.0]]])


def test_update_on_paper() -> None:
    # x = [1, 1], P = [[2, 1], [1, 1]], z = 2, R = 1: y = 1, S = 3, K = [2/3, 1/3],
    # x = [1 + 2/3, 1 + 1/3], P = (I - K H) P = [[2 - 4/3, 1 - 2/3], [1 - 2/3, 1 - 1/3]].
    P = np.array([[[2.0, 1.0], [1.0, 1.0]]])
    x, P = kalman.update(np.array([[1.0, 1.0]]), P, np.array([[2.0]]), R)
    np.testing.assert_allclose(x, [[5 / 3, 4 / 3]])
    np.testing.assert_allclose(P, [[[2 / 3, 1 / 3], [1 / 3, 2 / 3]]])


def test_gating_distance_on_paper() -> None:
    # S = 2 + 1 = 3 for both tracks; y = 1, 4 and 0, 3: y^2 / 3 = 1/3, 16/3 and 0, 3.
    x = np.array([[1.0, 1.0], [2.0, 0.0]])
    P = np.array([[[2.0, 1.0], [1.0, 1.0]]] * 2)
    d2 = kalman.gate(x, P, np.array([[2.0], [5.0]]), np.ones((2, 1, 1)))
    np.testing.assert_allclose(d2, [[1 / 3, 16 / 3], [0.0, 3.0]])


def test_gating_distances_are_those_of_each_pair() -> None:
    rng = np.random.default_rng(5)
    x, z = rng.normal(size=(4, 6)), rng.normal(size=(7, 3))
    P, noise = (r @ r.swapaxes(-1, -2) for r in (rng.normal(size=(4, 6, 6)), np.ones((7, 3, 3))))
    noise = noise + np.diag([1e-6, 1.0, 1e4])
    d2 = kalman.gate(x, P, z, noise)
    for i in range(4):
        for j in range(7):
            y, S = kalman.innovation(x[i], P[i], z[j], noise[j])
            np.testing.assert_allclose(d2[i, j], y @ np.linalg.solve(S, y), rtol=1e-9)


def test_a_stack_gives_what_its_members_give() -> None:
    rng = np.random.default_rng(1)
    x, z = rng.normal(size=(4, 6)), rng.normal(size=(4, 3))
    root = rng.normal(size=(4, 6, 6))
    P = root @ root.swapaxes(-1, -2) + np.eye(6)
    noise = np.array([np.eye(3) * (k + 1) for k in range(4)])
    stacked = kalman.update(x, P, z, noise)
    for k in range(4):
        one = kalman.update(x[k], P[k], z[k], noise[k])
        np.testing.assert_allclose(stacked[0][k], one[0])
        np.testing.assert_allclose(stacked[1][k], one[1])


def test_joseph_form_equals_the_textbook_form() -> None:
    rng = np.random.default_rng(2)
    root = rng.normal(size=(6, 6))
    P, noise, h = root @ root.T + np.eye(6), np.diag([0.1, 0.2, 0.3]), np.eye(3, 6)
    _, corrected = kalman.update(np.zeros(6), P, np.ones(3), noise)
    K = P @ h.T @ np.linalg.inv(h @ P @ h.T + noise)
    np.testing.assert_allclose(corrected, (np.eye(6) - K @ h) @ P, atol=1e-12)


def test_almost_certain_measurement_keeps_the_covariance_positive_definite() -> None:
    # The textbook form (I - K H) P loses definiteness here: 1 - 1e12 / (1e12 + 1e-12) is 0.
    P = np.eye(2)[None] * 1e12
    _, corrected = kalman.update(np.zeros((1, 2)), P, np.ones((1, 1)), R * 1e-12)
    assert np.linalg.eigvalsh(corrected[0])[0] == pytest.approx(1e-12, rel=1e-3)
