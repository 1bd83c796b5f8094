"""Differences between methods with their intervals, on manually written units."""

import numpy as np
import pytest

from benchmarks.lib.intervals import jackknife, poisson_rate
from common.metrics.intervals import PooledFigure, compare, pool
from people4d.messages import F64

ERROR = PooledFigure("error m", root=True)
SHARE = PooledFigure("right %", "{:.1f}", 100.0, higher_is_better=True)


def units(*rights: float) -> F64:
    """Return units of ten matches with an error of 2 m each, and so many right ones."""
    return np.array([[(40.0, 10.0), (right, 10.0)] for right in rights])


def test_figures_are_pooled_before_the_ratio_is_taken() -> None:
    sums = np.array([[(9.0, 1.0), (1.0, 2.0)], [(1.0, 9.0), (0.0, 6.0)]]).sum(axis=0)
    assert pool(sums, (ERROR, SHARE)).tolist() == [1.0, 12.5]  # sqrt(10 / 10), 100 * 1 / 8


def test_figure_without_matches_is_nan() -> None:
    assert np.isnan(pool(np.zeros((1, 2)), (ERROR,))).all()


def test_same_method_differs_by_nothing() -> None:
    differences = compare(units(3, 8, 5), units(3, 8, 5), (ERROR, SHARE))
    assert [(d.value, d.low, d.high) for d in differences] == [(0.0, 0.0, 0.0)] * 2
    assert not any(d.is_worse or d.is_better for d in differences)


def test_loss_in_all_units_is_worse() -> None:
    _, right = compare(units(2, 7, 4, 5), units(3, 8, 5, 6), (ERROR, SHARE))
    assert right.value == pytest.approx(-10.0)
    assert right.is_worse
    assert not right.is_better
    assert str(right) == "**-10.0 [-10.0, -10.0]**"


def test_loss_in_one_of_many_units_is_within_the_interval() -> None:
    # One of eight units is absent from a resample with probability (7 / 8)^8 = 0.34.
    _, right = compare(units(0, *[5] * 7), units(*[5] * 8), (ERROR, SHARE))
    assert right.value == pytest.approx(-6.25)
    assert right.high == 0.0
    assert not right.is_worse


def test_larger_error_is_worse() -> None:
    method, reference = units(5, 5), units(5, 5)
    method[:, 0, 0] = 90.0
    error, _ = compare(method, reference, (ERROR, SHARE))
    assert error.value == pytest.approx(1.0)  # sqrt(9) - sqrt(4)
    assert error.is_worse


def test_units_are_drawn_in_pairs() -> None:
    # Units differ by much more than the methods do: only pairs show the difference.
    reference = units(0, 2, 4, 6, 8, 9)
    _, right = compare(units(1, 3, 5, 7, 9, 10), reference, (ERROR, SHARE))
    assert right.is_better


def test_jackknife_of_a_mean_is_student_s_interval() -> None:
    """1, 2, 3, 4: standard error sqrt(5 / 3 / 4) = 0.645, times 3.182 for three degrees."""
    values = np.array([1.0, 2.0, 3.0, 4.0])
    found = jackknife(lambda chosen: {"mean": float(values[list(chosen)].mean()), "none": None}, 4)
    assert found == {"mean": pytest.approx((2.5, 2.5 - 2.054, 2.5 + 2.054), abs=1e-3)}


def test_few_units_have_no_interval() -> None:
    found = jackknife(lambda chosen: {"count": float(len(chosen))}, 2)
    assert found["count"] == pytest.approx((2.0, np.nan, np.nan), nan_ok=True)


def test_rate_of_a_count_has_the_exact_interval_of_poisson() -> None:
    """0 of 2 hours: -ln(0.025) / 2; five: 1.6235 to 11.6683."""
    assert poisson_rate(0, 2.0) == pytest.approx((0.0, 0.0, 3.6889 / 2), abs=1e-4)
    assert poisson_rate(5, 1.0) == pytest.approx((5.0, 1.6235, 11.6683), abs=1e-4)
