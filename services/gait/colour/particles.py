"""One state out of many particles (method book section 8.1)."""

from collections.abc import Callable, Mapping

import numpy as np

from people4d.messages import F64

Estimator = Callable[[F64, F64, float], F64]


def weighted_sum(states: F64, weights: F64, window_px: float) -> F64:  # noqa: ARG001
    """Return the mean of all particles by weight.

    Args:
        states: PxNxS.
        weights: PxN, each row sums to 1.
        window_px: Not used.

    Returns:
        PxS.

    Source: method book section 8.1 [G 3.10].
    """
    return np.asarray(np.einsum("pn,pns->ps", weights, states))


def map_estimate(states: F64, weights: F64, window_px: float) -> F64:  # noqa: ARG001
    """Return the particle with the largest weight; see `weighted_sum`."""
    return np.asarray(states[np.arange(len(states)), weights.argmax(axis=1)])


def robust_mean(states: F64, weights: F64, window_px: float) -> F64:
    """Return the mean by weight of the particles near the one with the largest weight.

    Args:
        states: PxNxS, of which the first two are x and y.
        weights: PxN, each row sums to 1.
        window_px: How far from it in x and in y a particle is near.

    Returns:
        PxS.

    Source: method book section 8.1.
    """
    best = map_estimate(states, weights, window_px)
    near = np.all(np.abs(states[..., :2] - best[:, None, :2]) <= window_px, axis=-1)
    kept = weights * near
    return weighted_sum(states, kept / kept.sum(axis=1, keepdims=True), window_px)


def spread_px(states: F64, weights: F64) -> F64:
    """Return the standard deviation of the particles' centres, P, in pixels."""
    centres = states[..., :2]
    mean = np.einsum("pn,pns->ps", weights, centres)
    squares = ((centres - mean[:, None]) ** 2).sum(axis=-1)
    return np.asarray(np.sqrt((weights * squares).sum(axis=1)))


ESTIMATORS: Mapping[str, Estimator] = {
    "weighted_sum": weighted_sum,
    "map": map_estimate,
    "robust_mean": robust_mean,
}
