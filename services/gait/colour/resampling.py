"""Which particles go on: drawn by weight, for many people at once (method book section 8.1)."""

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from people4d.messages import F64

I64 = npt.NDArray[np.int64]
Resampler = Callable[[F64, np.random.Generator], I64]


def systematic(weights: F64, generator: np.random.Generator) -> I64:
    """Draw with one random number for each person: N places at equal distance.

    Args:
        weights: PxN, each row sums to 1.
        generator: Of random numbers.

    Returns:
        PxN, which particle each new one is a copy of; a particle of weight w comes N w times,
        rounded up or down.
    """
    people, count = weights.shape
    return _drawn(weights, (np.arange(count) + generator.random((people, 1))) / count)


def stratified(weights: F64, generator: np.random.Generator) -> I64:
    """Draw one place at random from each of N equal parts; see `systematic`."""
    people, count = weights.shape
    return _drawn(weights, (np.arange(count) + generator.random((people, count))) / count)


def multinomial(weights: F64, generator: np.random.Generator) -> I64:
    """Draw each place at random; see `systematic`."""
    return _drawn(weights, np.sort(generator.random(weights.shape), axis=1))


def residual(weights: F64, generator: np.random.Generator) -> I64:
    """Copy each particle floor(N w) times, and draw the rest by what is left; see `systematic`."""
    count = weights.shape[1]
    chosen = np.empty(weights.shape, np.int64)
    for row, shares in enumerate(weights * count):
        # The tiny number keeps 5 times 1/5 from being 0.99.
        whole = np.floor(shares + 1e-9).astype(np.int64)
        sure = np.repeat(np.arange(count), whole)
        rest = np.clip(shares - whole, 0.0, None)
        missing = count - len(sure)
        drawn = np.empty(0, np.int64)
        if missing:
            drawn = generator.choice(count, missing, p=rest / rest.sum())
        chosen[row] = np.sort(np.concatenate([sure, drawn]))
    return chosen


def _drawn(weights: F64, places: F64) -> I64:
    """Return the particle at each place of the summed weights; places rise along a row."""
    people, count = weights.shape
    sums = np.cumsum(weights, axis=1)
    sums[:, -1] = 1.0  # whatever rounding makes of it
    # One search for all: the sums of each person lie above those of the one before.
    above = np.arange(people)[:, None]
    found = np.searchsorted((sums + above).ravel(), (places + above).ravel(), side="right")
    return np.asarray(np.clip(found.reshape(people, count) - above * count, 0, count - 1), np.int64)


RESAMPLERS: Mapping[str, Resampler] = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
    "multinomial": multinomial,
}
