"""Costs, gates and assignments worked on paper (docs/method.md sections 4 and 5)."""

import numpy as np
import pytest

from people4d.messages import F64
from services.tracker.interface import Measurement
from services.tracker.sort3d import sort3d
from services.tracker.sort3d.association import (
    adaptive_gate,
    assign,
    associate,
    cosine_distances,
    distances,
    min_max,
)
from services.tracker.strongsort3d import strongsort3d
from services.tracker.strongsort3d.strongsort3d import moving_averages

INF = np.inf


def test_sum_of_costs_is_minimised_not_the_best_pair() -> None:
    # 1 + 5 = 6 against 2 + 3 = 5.
    assert assign(np.array([[1.0, 2.0], [3.0, 5.0]])) == [(0, 1), (1, 0)]


def test_as_many_pairs_as_possible_are_matched() -> None:
    # Two pairs of 0.3 + 0.25 in place of one of 0.01.
    assert assign(np.array([[0.01, 0.3], [0.25, INF]])) == [(0, 1), (1, 0)]


def test_inadmissible_pairs_are_never_matched() -> None:
    assert assign(np.array([[INF, INF], [INF, 7.0]])) == [(1, 1)]
    assert assign(np.array([[INF]])) == []
    assert assign(np.zeros((0, 3))) == []
    assert assign(np.zeros((3, 0))) == []


def test_column_without_admissible_pair_changes_nothing() -> None:
    # Row 1 may only take column 0, so row 0 takes column 2 though 0 would be cheaper.
    cost = np.array([[1.0, INF, 900.0], [2.0, INF, INF]])
    assert assign(cost) == [(0, 2), (1, 0)]


def test_nan_is_no_admissible_cost() -> None:
    assert assign(np.array([[np.nan, 1.0], [2.0, np.nan]])) == [(0, 1), (1, 0)]


def test_unmatched_tracks_and_detections_are_returned() -> None:
    result = associate(np.array([[INF, 1.0], [INF, INF]]), "ab", "xy")
    assert result.matches == [("a", "y")]
    assert result.unmatched_tracks == ["b"]
    assert result.unmatched_detections == ["x"]


def test_adaptive_gate() -> None:
    # Distances 1, 3: mu = 2, sigma = 1 (population): tau = 2 + 1.6 = 3.6.
    assert adaptive_gate(np.array([[1.0, 3.0]])) == pytest.approx(3.6)
    # Distances 0.1, 2, 2, 0.3: mu = 1.1, deviations 1, 0.9, 0.9, 0.8: variance
    # (1 + 0.81 + 0.81 + 0.64) / 4 = 0.815, sigma = 0.902774: tau = 1.1 + 1.444438 = 2.544438.
    assert adaptive_gate(np.array([[0.1, 2.0], [2.0, 0.3]])) == pytest.approx(2.544438, abs=1e-6)
    assert adaptive_gate(np.zeros((0, 2))) == INF


def test_min_max() -> None:
    np.testing.assert_allclose(min_max(np.array([[1.0, 2.0, 5.0]])), [[0.0, 0.25, 1.0]])
    np.testing.assert_array_equal(min_max(np.array([[3.0]])), [[0.0]])
    np.testing.assert_array_equal(min_max(np.array([[3.0, 3.0]])), [[0.0, 0.0]])
    assert min_max(np.zeros((0, 2))).shape == (0, 2)


def test_sort3d_cost() -> None:
    # d = 1, 2, 5: d_n = 0, 0.25, 1. c = 0.3 (1 - IoU) + 0.7 d_n:
    # 0.3 * 0.2 = 0.06; 0.3 * 0.5 + 0.7 * 0.25 = 0.325; 0.3 + 0.7 = 1.
    cost = sort3d.combined_cost(np.array([[0.8, 0.5, 0.0]]), np.array([[1.0, 2.0, 5.0]]))
    np.testing.assert_allclose(cost, [[0.06, 0.325, 1.0]])


def test_strongsort3d_cost() -> None:
    # lambda = 0.02: 0.02 * 2 + 0.98 * 0.1 = 0.138.
    cost = strongsort3d.combined_cost(np.array([[2.0]]), np.array([[0.1]]), 0.3)
    np.testing.assert_allclose(cost, [[0.138]])


def test_both_gates_of_strongsort3d() -> None:
    # chi^2 of 3 degrees of freedom at 95 % is 7.8147; C_cos = 0.3.
    d_m2 = np.array([[7.8147, 7.8148, 1.0, 1.0]])
    d_cos = np.array([[0.1, 0.1, 0.3, 0.3001]])
    cost = strongsort3d.combined_cost(d_m2, d_cos, 0.3)
    np.testing.assert_array_equal(np.isfinite(cost), [[True, False, True, False]])


def test_motion_stands_in_for_unknown_appearance() -> None:
    # d_M^2 at half its gate is equivalent to d_cos at half its gate: 0.3 / 2 = 0.15; c = 0.02 *
    # 3.90735 + 0.98 * 0.15 = 0.225147. Beyond the gate the pair is inadmissible.
    d_m2 = np.array([[7.8147 / 2, 7.9]])
    cost = strongsort3d.combined_cost(d_m2, np.full((1, 2), np.nan), 0.3)
    np.testing.assert_allclose(cost, [[0.225147, INF]])


def with_embedding(embedding: F64 | None) -> Measurement:
    return Measurement(0, np.array([0.0, 0, 1, 1]), 1.0, np.zeros(3), 1.0, embedding=embedding)


def test_cosine_distances() -> None:
    # a.b of (1, 0) with (0.6, 0.8) is 0.6: distance 0.4; with itself 0; with (-1, 0) 2.
    a = np.array([1.0, 0.0])
    other = [with_embedding(vector) for vector in (np.array([0.6, 0.8]), a, -a, None)]
    apart = cosine_distances([with_embedding(a), with_embedding(None)], other)
    np.testing.assert_allclose(apart[0, :3], [0.4, 0.0, 2.0])
    assert np.isnan(apart[1]).all()
    assert np.isnan(apart[0, 3])
    assert np.isnan(cosine_distances([with_embedding(None)], [with_embedding(None)])).all()


def test_distances() -> None:
    a, b = np.array([[0.0, 0.0, 0.0]]), np.array([[3.0, 4.0, 0.0], [2.0, 3.0, 6.0]])
    np.testing.assert_allclose(distances(a, b), [[5.0, 7.0]])


def test_moving_averages_of_embeddings() -> None:
    # 0.9 (1, 0) + 0.1 (0, 1) = (0.9, 0.1), length sqrt(0.82) = 0.905539; opposite ones vanish.
    e, f = np.array([[1.0, 0.0], [1.0, 0.0]]), np.array([[0.0, 1.0], [-1.0, 0.0]])
    means = np.vstack([moving_averages(e[:1], f[:1], 0.9), moving_averages(e[1:], f[1:], 0.5)])
    np.testing.assert_allclose(means, [[0.993884, 0.110432], [-1.0, 0.0]], atol=1e-6)
