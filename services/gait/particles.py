"""Particle filter steps for many people at once: motion, resampling, state estimate.

A box state is [x, y, x', y', w, h, w', h']: centre and size in pixels, and their change in pixels a
frame. With a state of 4 the size stays, which is the same model without noise of the size.

Source: docs/method.md, section 8.1 [Gordon 1993].
"""

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from people4d.messages import F64
from services.gait.config import ColourLayerConfig

I64 = npt.NDArray[np.int64]
Resampler = Callable[[F64, np.random.Generator], I64]
Estimator = Callable[[F64, F64, float], F64]

STATES = 8
FIRST = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]], np.float64)
SECOND = np.array([[0.5, 0, 0.5, 0], [0, 0.5, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]], np.float64)


class BoxMotionModel:
    """Moves particles and adds noise.

    Args:
        config: Order, sampling and noise.

    Source: docs/method.md, section 8.1 (G 3.2, 3.11, 3.30 to 3.32).
    """

    def __init__(self, config: ColourLayerConfig) -> None:
        self._config = config
        matrix = np.zeros((STATES, STATES))
        matrix[:4, :4] = matrix[4:, 4:] = FIRST if config.order == 1 else SECOND
        self._transposed = matrix.T
        self._tau = np.array(config.tau)
        if config.state == 4:
            self._tau[4:] = 0.0

    def __call__(self, states: F64, previous: F64, generator: np.random.Generator) -> F64:
        """Return the particles of the next frame.

        Args:
            states: PxNx8.
            previous: PxNx8, the same particles one frame earlier; used by the second order.
            generator: Random numbers.
        """
        noise = self._tau * generator.standard_normal(states.shape)
        if self._config.sampling == "hierarchical":
            noise[..., :2] = self._stretched(noise[..., :2], states)
            if self._config.state == STATES:
                noise[..., 6:] += self._growth(states, generator)[..., None]
        if self._config.order == 1:
            moved = states @ self._transposed
        else:
            moved = states + (states - previous) @ self._transposed
        if self._config.state == 4:
            moved[..., 4:] = states[..., 4:]
        moved += noise
        np.maximum(moved[..., 4:6], self._config.box_min_px, out=moved[..., 4:6])
        return np.asarray(moved)

    def _stretched(self, noise: F64, states: F64) -> F64:
        """Rotate and stretch the noise of the first particles along their motion."""
        config = self._config
        velocities = states[..., 2:4]
        speeds = np.linalg.norm(velocities, axis=-1, keepdims=True)
        along = velocities / np.maximum(speeds, 1e-9)
        across = along[..., ::-1] * (-1.0, 1.0)
        stretched = (
            noise[..., :1] * config.along_stretch * along
            + noise[..., 1:] / config.along_stretch * across
        )
        chosen = np.arange(noise.shape[-2])[:, None] < config.along_share * noise.shape[-2]
        return np.where(chosen & (speeds >= config.speed_min_px), stretched, noise)

    def _growth(self, states: F64, generator: np.random.Generator) -> F64:
        """Return the addition of hierarchical sampling to w' and h'.

        The faster the sideways motion, the less the box may grow or shrink. Only the spread of
        a / x' is used: its mean would shrink every box that moves to the left. The faster the
        motion down, towards the camera, the more the box grows.
        """
        config = self._config
        a, b = generator.normal(1.0, 1.0, (2, *states.shape[:-1]))
        sideways = np.maximum(np.abs(states[..., 2]), config.speed_min_px)
        spread = config.growth_sideways_px2 * (a - 1.0) / sideways
        return np.asarray(spread + config.growth_upright * b * states[..., 3])


def systematic(weights: F64, generator: np.random.Generator) -> I64:
    """Draw at N equally spaced positions, with one random number for each person.

    Args:
        weights: PxN, each row sums to 1.
        generator: Random numbers.

    Returns:
        PxN, index of the particle that each new one is a copy of; a particle of weight w is copied
        N w times, rounded up or down.
    """
    people, count = weights.shape
    return _search(weights, (np.arange(count) + generator.random((people, 1))) / count)


def stratified(weights: F64, generator: np.random.Generator) -> I64:
    """Draw at one random position in each of N equal parts [Kitagawa 1996]; see `systematic`."""
    people, count = weights.shape
    return _search(weights, (np.arange(count) + generator.random((people, count))) / count)


def multinomial(weights: F64, generator: np.random.Generator) -> I64:
    """Draw at independent random positions; see `systematic`."""
    return _search(weights, np.sort(generator.random(weights.shape), axis=1))


def residual(weights: F64, generator: np.random.Generator) -> I64:
    """Copy floor(N w) times, draw the rest by remainder [Liu 1998]; see `systematic`."""
    count = weights.shape[1]
    chosen = np.empty(weights.shape, np.int64)
    for row, expected in enumerate(weights * count):
        # The tiny number keeps 5 times 1/5 from being 0.99.
        copies = np.floor(expected + 1e-9).astype(np.int64)
        copied = np.repeat(np.arange(count), copies)
        rest = np.clip(expected - copies, 0.0, None)
        missing = count - len(copied)
        drawn = np.empty(0, np.int64)
        if missing:
            drawn = generator.choice(count, missing, p=rest / rest.sum())
        chosen[row] = np.sort(np.concatenate([copied, drawn]))
    return chosen


def _search(weights: F64, positions: F64) -> I64:
    """Return the particle at each position of the cumulated weights; positions rise along a row."""
    people, count = weights.shape
    sums = np.cumsum(weights, axis=1)
    sums[:, -1] = 1.0  # exact in spite of rounding
    # One search for all: the sums of each person lie above those of the one before.
    above = np.arange(people)[:, None]
    found = np.searchsorted((sums + above).ravel(), (positions + above).ravel(), side="right")
    return np.asarray(np.clip(found.reshape(people, count) - above * count, 0, count - 1), np.int64)


RESAMPLERS: Mapping[str, Resampler] = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
    "multinomial": multinomial,
}


def weighted_sum(states: F64, weights: F64, window_px: float) -> F64:  # noqa: ARG001
    """Return the weighted mean of all particles.

    Args:
        states: PxNxS, the first two are x and y.
        weights: PxN, each row sums to 1.
        window_px: Of `robust_mean` only.

    Returns:
        PxS.

    Source: docs/method.md, section 8.1 (G 3.10).
    """
    return np.asarray(np.einsum("pn,pns->ps", weights, states))


def map_estimate(states: F64, weights: F64, window_px: float) -> F64:  # noqa: ARG001
    """Return the particle with the largest weight; see `weighted_sum`."""
    return np.asarray(states[np.arange(len(states)), weights.argmax(axis=1)])


def robust_mean(states: F64, weights: F64, window_px: float) -> F64:
    """Return the weighted mean within a window of x and y about `map_estimate`."""
    best = map_estimate(states, weights, window_px)
    near = np.all(np.abs(states[..., :2] - best[:, None, :2]) <= window_px, axis=-1)
    inside = weights * near
    return weighted_sum(states, inside / inside.sum(axis=1, keepdims=True), window_px)


ESTIMATORS: Mapping[str, Estimator] = {
    "weighted_sum": weighted_sum,
    "map": map_estimate,
    "robust_mean": robust_mean,
}


def centre_sigma_px(states: F64, weights: F64) -> F64:
    """Return the standard deviation of the particles' centres, P, in pixels."""
    centres = states[..., :2]
    mean = np.einsum("pn,pns->ps", weights, centres)
    squares = ((centres - mean[:, None]) ** 2).sum(axis=-1)
    return np.asarray(np.sqrt((weights * squares).sum(axis=1)))
