"""Resampling and motion models by hand."""

import numpy as np
import pytest

from services.gait.config import PUBLISHED_TAU, ColourLayerConfig
from services.gait.particles import BoxMotionModel, resample_systematic


class Half(np.random.Generator):
    """Every random number is a half."""

    def random(self, *args: object, **_: object) -> np.ndarray:  # type: ignore[override]
        return np.full(args[0], 0.5)  # type: ignore[call-overload,no-any-return]


def test_systematic_by_hand() -> None:
    # Positions 1/8, 3/8, 5/8, 7/8; cumulated weights 0.5, 0.75, 1: twice the first, one of each.
    # For the second person 0.1, 0.1, 1: one position lies below 0.1 + 0, so all are the third.
    weights = np.array([[0.5, 0.25, 0.25, 0.0], [0.1, 0.0, 0.9, 0.0]])
    chosen = resample_systematic(weights, Half(np.random.PCG64(0)))
    assert chosen.tolist() == [[0, 0, 1, 2], [2, 2, 2, 2]]


def test_resampling_keeps_the_mean() -> None:
    # The mean of 200 resampled means of 50 particles lies within 4 standard errors of the
    # weighted mean.
    generator = np.random.default_rng(3)
    values = generator.normal(0.0, 10.0, (2, 50))
    weights = generator.random((2, 50))
    weights /= weights.sum(axis=1, keepdims=True)
    mean = (weights * values).sum(axis=1)
    sigma = np.sqrt((weights * (values - mean[:, None]) ** 2).sum(axis=1))
    found = [
        np.take_along_axis(values, resample_systematic(weights, generator), axis=1).mean(axis=1)
        for _ in range(200)
    ]
    assert np.all(np.abs(np.mean(found, axis=0) - mean) < 4 * sigma / np.sqrt(50 * 200))


def test_particle_with_all_weight_is_the_only_one_left() -> None:
    weights = np.zeros((3, 7))
    weights[[0, 1, 2], [0, 3, 6]] = 1.0
    chosen = resample_systematic(weights, np.random.default_rng(0))
    assert np.all(chosen == [[0], [3], [6]])


def test_equal_weights_copy_each_particle_once() -> None:
    chosen = resample_systematic(np.full((2, 9), 1 / 9), np.random.default_rng(0))
    assert chosen.tolist() == [list(range(9))] * 2


def moved(start: list[float], before: list[float], **fields: object) -> list[float]:
    config = ColourLayerConfig(particles=1, tau=(0.0,) * 8, **fields)  # type: ignore[arg-type]
    model = BoxMotionModel(config)
    generator = np.random.default_rng(0)
    (row,) = model(np.array([[start]], float), np.array([[before]], float), generator)[0]
    return list(map(float, row))


STATE, BEFORE = [100.0, 50, 4, -2, 30, 60, 1, 2], [98.0, 51, 3, -1, 29, 58, 1, 1]


def test_the_first_order_is_constant_velocity() -> None:
    assert moved(STATE, BEFORE) == [104.0, 48, 4, -2, 31, 62, 1, 2]
    assert moved(STATE, BEFORE, state=4) == [104.0, 48, 4, -2, 30, 60, 1, 2]


def test_the_second_order_by_hand() -> None:
    # s + A' (s - s'), s - s' = (2, -1, 1, -1 | 1, 2, 0, 1): x + 0.5*2 + 0.5*1 = 101.5,
    # y + 0.5*-1 + 0.5*-1 = 49, x' + 1 = 5, y' - 1 = -3; w + 0.5*1 + 0 = 30.5, h + 1 + 0.5 = 61.5.
    assert moved(STATE, BEFORE, order=2) == [101.5, 49, 5, -3, 30.5, 61.5, 1, 3]


def test_noise_is_as_large_as_tau() -> None:
    model = BoxMotionModel(ColourLayerConfig(particles=20_000, tau=PUBLISHED_TAU))
    still = np.zeros((1, 20_000, 8))
    still[..., 4:6] = 100.0
    noise = model(still, still, np.random.default_rng(0))[0] - still[0]
    assert noise.std(axis=0) == pytest.approx([10, 10, 1, 1, 0.1, 0.1, 0.1, 0.1], rel=0.05)
    assert np.abs(noise.mean(axis=0)) == pytest.approx(np.zeros(8), abs=0.3)


SIZE_SIGMA = 0.01


def hierarchical(vx: float, vy: float) -> np.ndarray:
    config = ColourLayerConfig(
        particles=20_000,
        tau=(10.0, 10.0, 1.0, 1.0, 0.1, 0.1, SIZE_SIGMA, SIZE_SIGMA),
        sampling="hierarchical",
    )
    states = np.zeros((1, 20_000, 8))
    states[..., 2:6] = vx, vy, 100.0, 200.0
    return np.asarray(BoxMotionModel(config)(states, states, np.random.default_rng(0))[0])


def test_hierarchical_sampling_couples_size_to_motion() -> None:
    damp, fast = hierarchical(1.0, 0.0)[:, 6], hierarchical(20.0, 0.0)[:, 6]
    # Together with tau = 0.01 it is 0.02 / |x'|: sqrt(0.01^2 + 0.02^2) = 0.02236, and
    # sqrt(0.01^2 + 0.001^2) = 0.01005 when fast.
    assert damp.std() == pytest.approx(0.02236, rel=0.03)
    assert fast.std() == pytest.approx(0.01005, rel=0.03)
    # Down at 10 px a frame: grows by 0.005 * 10 on average; up it shrinks. The height does so, too.
    down, up = hierarchical(0.0, 10.0), hierarchical(0.0, -10.0)
    assert down[:, 6:].mean(axis=0) == pytest.approx([0.05, 0.05], abs=0.002)
    assert up[:, 6:].mean(axis=0) == pytest.approx([-0.05, -0.05], abs=0.002)


def test_hierarchical_sampling_stretches_noise_along_the_motion() -> None:
    # Moving down: half of the particles have sigma 14 along y and 10 / 1.4 across, half 10.
    noise = hierarchical(0.0, 10.0)[:, :2] - (0.0, 10.0)
    assert noise[:10_000].std(axis=0) == pytest.approx([10 / 1.4, 14.0], rel=0.05)
    assert noise[10_000:].std(axis=0) == pytest.approx([10.0, 10.0], rel=0.05)
    # Without motion there is no direction.
    assert hierarchical(0.0, 0.0)[:, :2].std(axis=0) == pytest.approx([10.0, 10.0], rel=0.05)


@pytest.mark.parametrize(
    "fields", [{"particles": 0}, {"sigma": 0.0}, {"sigma": float("inf")}, {"tau": (-1.0,) * 8}]
)
def test_invalid_configuration_is_refused(fields: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="expected"):
        ColourLayerConfig(**fields)  # type: ignore[arg-type]
