"""Noise: normal, of the same strength everywhere, and lasting as long as configured."""

import math

import numpy as np
import pytest

from lab.depth.noise import NoiseField, NoiseProcess, Persistence, threshold
from tests.lab.depth.sensors import correlation

PARTLY_FROZEN = Persistence(frozen_share=0.3, correlation_s=0.2)
RUNNING = Persistence(frozen_share=0.0, correlation_s=0.2)


def test_correlation_by_hand() -> None:
    # At lag 0 a value equals itself. After one knot only the shared knot is left: the mean of
    # sin(a) cos(b) with b = a is 1/pi. After two knots nothing is shared.
    assert correlation(RUNNING, 0) == pytest.approx(1)
    assert correlation(RUNNING, 0.2) == pytest.approx(1 / math.pi)
    assert correlation(RUNNING, 0.4) == pytest.approx(0)
    assert correlation(RUNNING, 9) == 0
    # The frozen part stays: 0.3 + 0.7/pi.
    assert correlation(PARTLY_FROZEN, 0.2) == pytest.approx(0.3 + 0.7 / math.pi)


@pytest.mark.parametrize("lag_s", [0.0, 0.05, 0.2, 0.33, 0.5])
def test_correlation_of_a_process_is_as_configured(lag_s: float) -> None:
    process = NoiseProcess((4000,), (1, 2), PARTLY_FROZEN)
    times = np.arange(40) * 0.2 * 1.618  # at all phases between the knots
    products = [np.mean(process.at(t) * process.at(t + lag_s)) for t in times]
    # 4000 frozen numbers alone give a standard error of 0.3 * sqrt(2/4000) = 0.007.
    assert np.mean(products) == pytest.approx(correlation(PARTLY_FROZEN, lag_s), abs=0.03)


def test_variance_is_one_at_every_pixel_and_time() -> None:
    field = NoiseField((13, 17), 5, (7,), RUNNING)
    # Knots 3 apart share nothing: 2000 independent images; standard error sqrt(2/2000) = 0.032.
    for phase in (0.0, 0.09):
        images = np.stack([field.at(k * 0.6 + phase) for k in range(2000)])
        variance = images.var(axis=0)
        assert variance == pytest.approx(1, abs=5 * 0.032)
        assert variance.mean() == pytest.approx(1, abs=0.05)


def test_field_is_smooth_and_independent_beyond_two_cells() -> None:
    field = NoiseField((40, 400), 10, (7,), RUNNING)
    images = np.stack([field.at(k * 0.6) for k in range(50)])
    near = np.mean(images[..., :-1] * images[..., 1:])
    far = np.mean(images[..., :-20] * images[..., 20:])
    assert near > 0.95
    assert abs(far) < 0.05


def test_any_order_gives_the_same_bytes() -> None:
    times = [0.0, 1.0, 0.04, 5.0, -3.0, 1.7e9]
    forward = [NoiseField((20, 30), 6, (7,), PARTLY_FROZEN).at(t).tobytes() for t in times]
    one = NoiseField((20, 30), 6, (7,), PARTLY_FROZEN)
    assert [one.at(t).tobytes() for t in reversed(times)] == forward[::-1]
    assert one.at(0.0).tobytes() != NoiseField((20, 30), 6, (8,), PARTLY_FROZEN).at(0.0).tobytes()


def test_threshold() -> None:
    values = NoiseProcess((100_000,), (3,), RUNNING).at(0)
    assert np.mean(values > threshold(0.1)) == pytest.approx(0.1, abs=0.004)
    assert threshold(0) == math.inf
    assert np.all(values > threshold(1))
