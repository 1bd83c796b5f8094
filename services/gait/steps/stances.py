"""Stances: position and time of a standing foot, by the best division of its path.

A path is divided into stances and swings. In a stance the velocity is zero and all samples measure
one position. Dynamic programming finds the division with the minimum cost. Samples are weighted by
their covariance, so noise in depth is not mistaken for motion.

Source: docs/method.md, section 20.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from people4d.messages import F64

Indices: TypeAlias = npt.NDArray[np.intp]

LENGTH_MIN_M = 0.2  # Minimum length of a step [m]
STANCE_MIN_S = 0.15  # Minimum time of a stance [s]
STANCE_MAX_S = 2.0  # Maximum stance of the search; longer ones are joined [s]
SWING_COST = 3.0  # Minimum squared deviation from standing of a swinging foot
# Minimum deviation of an outlier from the median, and number of samples in the median on either
# side
OUTLIER_SIGMAS, OUTLIER_NEAR = 4.0, 3
SAME_S = 0.05  # Correlation time of errors [s]
HIDDEN_COST = 0.1  # Cost of a bin of a swing without a sample
BEGIN_COST = 15.0  # Cost of a swing


@dataclass(frozen=True)
class Bins:
    """Samples of a foot, summed over equal periods; information is inverse covariance."""

    times_s: F64  # N, times of the middles
    information: F64  # Nx2x2, on the ground; 0 if there is no sample
    weighted_m: F64  # Nx2, positions times information
    squares: F64  # N, squared Mahalanobis distances to the origin

    @property
    def sampled(self) -> npt.NDArray[np.bool_]:
        """N, True where there is a sample."""
        return np.asarray(self.information[:, 0, 0] > 0)

    def position_m(self, begin: int, end: int) -> F64:
        """Return the mean position of some bins with samples, 2."""
        return np.linalg.solve(
            self.information[begin:end].sum(axis=0), self.weighted_m[begin:end].sum(axis=0)
        )


@dataclass(frozen=True)
class Stance:
    """Bins of a standing foot, from begin to end; the first and the last have samples."""

    begin: int
    end: int
    position_m: F64  # 2, on the ground


def collect_bins(
    times_s: F64, ground_m: F64, covariances_m2: F64, origin_s: float, count: int, bin_s: float
) -> Bins:
    """Return the samples of a foot in `count` bins.

    Args:
        times_s: N.
        ground_m: Nx2.
        covariances_m2: Nx2x2.
        origin_s: Beginning of the first bin.
        count: Number of bins.
        bin_s: Period of a bin.
    """
    information = np.linalg.inv(covariances_m2)
    weighted = np.einsum("nij,nj->ni", information, ground_m)
    bins = np.clip(((times_s - origin_s) / bin_s).astype(int), 0, count - 1)
    # Errors are correlated: all samples of SAME_S count as one, at any frame rate.
    shares = bin_s / SAME_S / np.maximum(np.bincount(bins, minlength=count), 1)[bins]
    found = Bins(
        np.asarray(origin_s + bin_s * (np.arange(count) + 0.5), np.float64),
        np.zeros((count, 2, 2)),
        np.zeros((count, 2)),
        np.zeros(count),
    )
    np.add.at(found.information, bins, shares[:, None, None] * information)
    np.add.at(found.weighted_m, bins, shares[:, None] * weighted)
    np.add.at(found.squares, bins, shares * (weighted * ground_m).sum(axis=1))
    return found


def find_inliers(ground_m: F64, covariances_m2: F64) -> npt.NDArray[np.bool_]:
    """Return the samples, Nx2, that are near the median of their neighbours, N."""
    if len(ground_m) < 3:
        return np.ones(len(ground_m), bool)
    padded = np.pad(ground_m, ((OUTLIER_NEAR, OUTLIER_NEAR), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * OUTLIER_NEAR + 1, axis=0)
    middle = np.median(windows, axis=2)
    spread = np.median(np.abs(windows - middle[..., None]), axis=2)
    noise = np.sqrt(np.einsum("nii->ni", covariances_m2))
    off = np.abs(ground_m - middle) / (noise + 1.5 * spread)
    return np.asarray((off < OUTLIER_SIGMAS).all(axis=1))


def find_stances(bins: Bins) -> list[Stance]:
    """Return the stances of a foot in the order of time; the rest are swings."""
    count = len(bins.times_s)
    bin_s = float(bins.times_s[1] - bins.times_s[0])
    least, most = (max(1, round(s / bin_s)) for s in (STANCE_MIN_S, STANCE_MAX_S))
    costs = _stance_costs(bins, most)
    moving = np.where(bins.sampled, SWING_COST, HIDDEN_COST) * bin_s / SAME_S
    standing, swinging = np.full(count + 1, np.inf), np.full(count + 1, np.inf)
    begins, after_stance = np.zeros(count + 1, int), np.zeros(count + 1, bool)
    swinging[0] = 0.0
    for end in range(1, count + 1):
        first = max(end - most, 0)
        if end - least >= first:
            options = (
                swinging[first : end - least + 1]
                + costs[end - 1, most - (end - first) :][: end - least - first + 1]
            )
            best = int(np.argmin(options))
            standing[end], begins[end] = options[best], first + best
        lifted = standing[end - 1] + BEGIN_COST
        after_stance[end] = lifted < swinging[end - 1]
        swinging[end] = min(lifted, swinging[end - 1]) + moving[end - 1]
    return _merged(bins, _traced(standing, swinging, begins, after_stance))


def _stance_costs(bins: Bins, most: int) -> F64:
    """Return the costs of stances by their last and first bin.

    Returns:
        Nxmost: at [last, k] of the stance that begins `most - 1 - k` bins before the last one.
    """
    count = len(bins.times_s)

    def summed(values: F64) -> F64:
        total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        ends = np.arange(count)[:, None]
        first = np.maximum(ends - np.arange(most)[::-1], 0)
        return np.asarray(total[ends + 1] - total[first])

    A, b, c = summed(bins.information), summed(bins.weighted_m), summed(bins.squares)
    determinant = A[..., 0, 0] * A[..., 1, 1] - A[..., 0, 1] * A[..., 1, 0]
    fitted = (
        A[..., 1, 1] * b[..., 0] ** 2
        - 2 * A[..., 0, 1] * b[..., 0] * b[..., 1]
        + A[..., 0, 0] * b[..., 1] ** 2
    ) / np.maximum(determinant, 1e-9)
    return np.asarray(np.maximum(c - fitted, 0.0))


def _traced(
    standing: F64, swinging: F64, begins: Indices, after_stance: npt.NDArray[np.bool_]
) -> list[tuple[int, int]]:
    """Return the first and last bins of the stances of the best division."""
    found, end = [], len(standing) - 1
    stands = bool(standing[end] <= swinging[end])
    while end > 0:
        if stands:
            found.append((int(begins[end]), end))
            end, stands = int(begins[end]), False
        else:
            stands = bool(after_stance[end])
            end -= 1
    return found[::-1]


def _merged(bins: Bins, spans: Sequence[tuple[int, int]]) -> list[Stance]:
    """Return stances without their hidden ends; stances at one position are merged."""
    found: list[Stance] = []
    for begin, end in spans:
        known = begin + np.flatnonzero(bins.sampled[begin:end])
        if not len(known):
            continue
        begin, end = int(known[0]), int(known[-1]) + 1
        one = Stance(begin, end, bins.position_m(begin, end))
        if found:
            gone_m = float(np.linalg.norm(one.position_m - found[-1].position_m))
            if gone_m < LENGTH_MIN_M:
                begin = found.pop().begin
                one = Stance(begin, end, bins.position_m(begin, end))
        found.append(one)
    return found
