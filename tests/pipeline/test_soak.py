"""Slopes and lost frames, worked out by hand."""

import numpy as np
import pytest

from benchmarks.lib.timeline import Frame, lost
from benchmarks.soak import slope


def test_a_line_has_its_slope_and_no_error() -> None:
    # 2 MB in 1800 s are 4 MB an hour.
    times_s = [0.0, 900.0, 1800.0]
    rise, error = slope(times_s, [10.0, 11.0, 12.0])
    assert rise == pytest.approx(4.0)
    assert error == pytest.approx(0.0, abs=1e-9)


def test_independent_noise_is_within_its_error_as_often_as_it_should() -> None:
    generator, times_s = np.random.default_rng(0), np.arange(300.0)
    found = [slope(list(times_s), list(generator.normal(0, 1, 300))) for _ in range(300)]
    inside = np.mean([abs(rise) < 1.96 * error for rise, error in found])
    assert 0.90 < inside < 0.99


def test_noise_that_lasts_makes_the_slope_less_sure() -> None:
    # A walk forgets with a time constant of ten looks: least squares alone would believe in slopes
    # that are not there.
    generator = np.random.default_rng(1)
    inside = []
    for _ in range(200):
        values = [0.0]
        for step in generator.normal(0, 1, 400):
            values.append(0.9 * values[-1] + step)
        rise, error = slope(list(np.arange(401.0)), values)
        inside.append(abs(rise) < 1.96 * error)
    assert np.mean(inside) > 0.85


def test_lost_frames_lie_evenly_between_those_that_came() -> None:
    frames = [Frame(k, k * 0.1, 0.02, "detector-1") for k in (0, 1, 4)]
    assert lost(frames) == pytest.approx([0.2, 0.3])
