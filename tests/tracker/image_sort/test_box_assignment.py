"""Overlap and assignment of boxes, by hand and against SciPy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from common.geometry.boxes import iou_xyxy
from services.tracker.image_sort.box_assignment import assign, iou, shortest_paths


def test_overlap_by_hand() -> None:
    # Two squares of 4, one beside the other by 1: 2 x 1 of 4 + 4 - 2.
    a, b = np.array([0.0, 0, 2, 2]), np.array([1.0, 0, 3, 2])
    assert iou(a, b) == pytest.approx(2 / 6)
    assert iou(a, np.array([2.0, 0, 4, 2])) == 0  # they touch
    assert iou(a, np.array([0.0, 5, 2, 7])) == 0


def test_overlap_is_that_of_the_numpy_function() -> None:
    rng = np.random.default_rng(2)
    corner = rng.uniform(0, 10, (12, 2))
    boxes = np.hstack([corner, corner + rng.uniform(0.5, 8, (12, 2))])
    ours = [[iou(a, b) for b in boxes] for a in boxes]
    np.testing.assert_allclose(ours, iou_xyxy(boxes, boxes))


def test_sum_is_minimised_not_the_best_pair() -> None:
    # Greedy would take 0.9 and leave 0.1: 1.0. The other way gives 0.8 + 0.7.
    assert list(assign(np.array([[0.9, 0.8], [0.7, 0.1]]))) == [1, 0]


def test_refused_pairs_are_never_matched() -> None:
    # Both rows want column 0; the second has nothing else, and column 1 is refused to it.
    assert list(assign(np.array([[0.5, 0.4], [0.6, 0.0]]))) == [1, 0]
    assert list(assign(np.array([[0.5, 0.0], [0.6, 0.0]]))) == [-1, 0]
    assert list(assign(np.zeros((2, 3)))) == [-1, -1]
    assert list(assign(np.zeros((0, 3)))) == []
    assert list(assign(np.zeros((2, 0)))) == [-1, -1]


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(1, 12), m=st.integers(1, 12))
def test_no_assignment_is_better(seed: int, n: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    gain = np.where(rng.random((n, m)) < 0.4, rng.uniform(0.3, 1.0, (n, m)), 0.0)
    column_of = assign(gain)
    taken = [j for j in column_of if j >= 0]
    assert len(set(taken)) == len(taken)
    assert all(gain[i, j] > 0 for i, j in enumerate(column_of) if j >= 0)
    rows, columns = linear_sum_assignment(-gain)
    ours = sum(gain[i, j] for i, j in enumerate(column_of) if j >= 0)
    assert ours == pytest.approx(gain[rows, columns].sum())


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(1, 8), more=st.integers(0, 4))
def test_shortest_paths_find_the_least_sum(seed: int, n: int, more: int) -> None:
    cost = np.random.default_rng(seed).normal(size=(n, n + more))
    found = shortest_paths(cost)
    rows, columns = linear_sum_assignment(cost)
    assert sorted(set(found)) == sorted(found)
    assert cost[range(n), found].sum() == pytest.approx(cost[rows, columns].sum())
