"""Walking as one model of body and feet: phase of the stride and length of the steps.

The phase is 0 at the landing of the left foot and 1/2 at the landing of the right one. It advances
with the path of the body, by half a stride in a step length, at any speed and frame rate. The
positions of both feet relative to the body follow from it: a standing foot stays on the ground, a
swinging one returns ahead. A measured foot may be the other one. The most likely sequence of phases
and lengths is found by dynamic programming [Viterbi 1967].

Source: docs/method.md, section 20.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from people4d.messages import F64

PHASES = 40  # Number of phases
LENGTHS_M = np.arange(0.25, 1.0, 0.1)  # Lengths of a step [m]
LENGTH_M, LENGTH_SIGMA_M = 0.6, 0.15  # Mean and standard deviation of the first length [m]
CHANGE_COST = 3.0  # Cost of a change to the next length
LIFT = 0.6  # Phase between landing and lift of a foot
ASIDE_M = 0.09  # Distance of a foot from the middle, across the path [m]
ALONG_SIGMA_M, ACROSS_SIGMA_M = 0.08, 0.12  # Noise of a foot, in addition to its covariance [m]
NOISE_M = 0.06  # Noise of a standing foot, in addition to the noise of its point [m]
EXCHANGED = 0.2  # Probability that a measured foot is the other one
OUTLIER = 1e-3  # Likelihood of any position, relative to the expected one
# Standard deviation of the advance: of each frame [phases], and relative to the root of the advance
ADVANCE_SIGMA, ADVANCE_RATIO = 0.5, 0.06
BIN_S = 0.08  # Minimum time between phases [s]
SMOOTH_S, SMOOTH_FRAMES = 0.2, 1.0  # Standard deviation of the kernel of the body's path
STANDING_MPS = 0.12  # Maximum speed of a standing body [m/s]
HEADING_MPS = 0.25  # Minimum speed with a direction [m/s]
OFFSET_COUNT = 6  # Number of samples at which half of the offset of the body is corrected

I64 = npt.NDArray[np.int64]


@dataclass(frozen=True)
class WalkSamples:
    """Body and feet of a person in N frames."""

    times_s: F64  # N, rising
    body_m: F64  # Nx2, on the ground
    feet_m: F64  # Nx2x2, left and right; NaN if unknown
    covariances_m2: F64  # Nx2x2x2

    @cached_property
    def information(self) -> F64:
        """Inverse covariances of footprints, Nx2x2x2."""
        return np.asarray(np.linalg.inv(self.covariances_m2 + NOISE_M**2 * np.eye(2)))


@dataclass(frozen=True)
class Walk:
    """Most likely walk in N frames."""

    phases: F64  # N, rising by 1 with each stride
    lengths_m: F64  # N, length of a step
    body_m: F64  # Nx2, smoothed and above the middle of the feet
    headings: F64  # Nx2, direction of the path


def fit_walk(samples: WalkSamples) -> Walk:
    """Return the most likely walk; the phase of a standing person does not advance."""
    body_m, headings, moved_m = _path(samples)
    axes = np.stack([headings, headings[:, ::-1] * (-1.0, 1.0)], axis=1)  # ahead, left
    # Feet are beside the head if the camera is tilted, and behind it if the trunk is bent.
    body_m = _centred(samples, body_m, np.broadcast_to(np.eye(2), axes.shape))
    body_m = _centred(samples, body_m, axes, (0.5 - LIFT) * LENGTH_M)
    bins = _bins(samples.times_s)
    scores = _scores(samples, _offsets(samples, body_m, axes), axes, bins)
    advance = np.diff(_means(np.cumsum(moved_m), bins), prepend=0.0)[:, None] / (2 * LENGTHS_M)
    sigma = np.sqrt(ADVANCE_SIGMA**2 + (ADVANCE_RATIO * PHASES) ** 2 * advance)
    start = scores[0] - 0.5 * ((LENGTHS_M - LENGTH_M) / LENGTH_SIGMA_M) ** 2
    found, lengths = _most_likely(start, scores, advance * PHASES, sigma, CHANGE_COST)
    phases = np.interp(samples.times_s, _means(samples.times_s, bins), found / PHASES)
    return Walk(phases, LENGTHS_M[lengths][bins], body_m, headings)


def foot_offset(phases: F64) -> F64:
    """Return the offset of a foot ahead of the body by the phase since its landing [lengths]."""
    phases = np.mod(phases, 1.0)
    swung = (phases - LIFT) / (1 - LIFT)
    return np.where(phases < LIFT, 0.5 - 2 * phases, (0.5 - 2 * LIFT) + 2 * LIFT * swung)


def _path(samples: WalkSamples) -> tuple[F64, F64, F64]:
    """Return the smoothed body (Nx2), its direction (Nx2) and its motion from each last frame (N).

    Local linear regression with a Gaussian kernel.
    """
    times_s = samples.times_s
    width_s = max(SMOOTH_S, SMOOTH_FRAMES * float(np.median(np.diff(times_s))))
    apart_s = times_s - times_s[:, None]
    weights = np.exp(-0.5 * (apart_s / width_s) ** 2)
    s0, s1, s2 = (np.sum(weights * apart_s**k, axis=1)[:, None] for k in range(3))
    y0, y1 = weights @ samples.body_m, (weights * apart_s) @ samples.body_m
    determinant = s0 * s2 - s1**2 + 1e-9
    body_m = (s2 * y0 - s1 * y1) / determinant
    velocity_mps = (s0 * y1 - s1 * y0) / determinant
    speeds = np.linalg.norm(velocity_mps, axis=1)
    moving = np.flatnonzero(speeds > HEADING_MPS)
    headings = np.tile((1.0, 0.0), (len(times_s), 1))
    if len(moving):  # slow frames have the last direction
        last = np.maximum(np.searchsorted(moving, np.arange(len(times_s)), side="right") - 1, 0)
        headings = velocity_mps[moving[last]] / speeds[moving[last], None]
    along_m = np.sum(np.diff(body_m, axis=0) * (headings[1:] + headings[:-1]) / 2, axis=1)
    walking = np.minimum(speeds[1:], speeds[:-1]) > STANDING_MPS
    return body_m, headings, np.append(0.0, np.where(walking, np.maximum(along_m, 0.0), 0.0))


def _offsets(samples: WalkSamples, body_m: F64, axes: F64) -> F64:
    """Return the feet from the body along axes (Nx2x2), Nx2x2."""
    return np.asarray(np.einsum("nij,nfj->nfi", axes, samples.feet_m - body_m[:, None]))


def _centred(samples: WalkSamples, body_m: F64, axes: F64, ahead_m: float = 0.0) -> F64:
    """Return the body moved along axes (Nx2x2) so that the median foot is `ahead_m` ahead of it."""
    offsets_m = _offsets(samples, body_m, axes)
    known = offsets_m[np.isfinite(offsets_m[..., 0])]
    if not len(known):
        return body_m
    ratio = len(known) / (len(known) + OFFSET_COUNT)
    return body_m + ratio * (np.median(known, axis=0) - (ahead_m, 0.0)) @ axes


def _bins(times_s: F64) -> I64:
    """Return the number of each frame's bin: a bin covers BIN_S, or one frame at lower rates."""
    edges = np.floor((times_s - times_s[0]) / BIN_S + 1e-6)
    return np.unique(edges, return_inverse=True)[1]


def _means(values: F64, bins: I64) -> F64:
    """Return the means of values over bins."""
    return np.bincount(bins, values) / np.bincount(bins)


def _scores(samples: WalkSamples, offsets_m: F64, axes: F64, bins: I64) -> F64:
    """Return the log-likelihoods of both feet by phase and length, BINSxPHASESxLENGTHS.

    Errors of a foot in neighbouring frames are alike, so a bin counts as one frame.

    `offsets_m` are the feet (Nx2x2) from the body along the axes (Nx2x2, ahead and left).
    """
    phases = np.arange(PHASES) / PHASES
    expected_m = [foot_offset(phases + half)[:, None] * LENGTHS_M for half in (0.0, 0.5)]
    noise_m2 = np.einsum("nij,nfjk,nik->nfi", axes, samples.covariances_m2, axes)
    noise_m2 = noise_m2 + np.square((ALONG_SIGMA_M, ACROSS_SIGMA_M))
    total = np.zeros((bins[-1] + 1, PHASES, len(LENGTHS_M)))
    for foot in (0, 1):
        known = np.isfinite(offsets_m[:, foot, 0])
        ahead_m, left_m = (offsets_m[known, foot, k, None, None] for k in (0, 1))
        ahead_m2, left_m2 = (noise_m2[known, foot, k, None, None] for k in (0, 1))
        own, other = (
            np.exp(
                -0.5 * (ahead_m - expected_m[side]) ** 2 / ahead_m2
                - 0.5 * (left_m - (ASIDE_M if side == 0 else -ASIDE_M)) ** 2 / left_m2
            )
            for side in (foot, 1 - foot)
        )
        score = np.log((1 - EXCHANGED) * own + EXCHANGED * other + OUTLIER)
        counts = np.bincount(bins[known], minlength=len(total))
        np.add.at(total, bins[known], score / counts[bins[known], None, None])
    return total


@compiled
def _most_likely(
    start: F64, scores: F64, advance: F64, sigma: F64, change_cost: float
) -> tuple[F64, I64]:
    """Return unwrapped phase and index of the length in each frame, of the best sequence.

    Args:
        start: PHASESxLENGTHS, scores of the first frame with the prior.
        scores: NxPHASESxLENGTHS.
        advance: NxLENGTHS, expected advance since the last frame [phases].
        sigma: NxLENGTHS, its standard deviation.
        change_cost: Cost of a change to the next length.
    """
    frames, phases, lengths = scores.shape
    best = start.copy()
    shifts = np.zeros(scores.shape, np.int64)
    before = np.zeros(scores.shape, np.int64)
    for frame in range(1, frames):
        found = np.empty((phases, lengths))
        for length in range(lengths):
            mean, spread = advance[frame, length], sigma[frame, length]
            low, high = int(np.floor(mean - 3 * spread)), int(np.ceil(mean + 3 * spread))
            # best length in the last frame, by phase
            last = best[:, length].copy()
            origin = np.full(phases, length)
            for other in (length - 1, length + 1):
                if 0 <= other < lengths:
                    for phase in range(phases):
                        if best[phase, other] - change_cost > last[phase]:
                            last[phase], origin[phase] = best[phase, other] - change_cost, other
            for phase in range(phases):
                most = -np.inf
                for shift in range(low, high + 1):
                    score = last[(phase - shift) % phases] - 0.5 * ((shift - mean) / spread) ** 2
                    if score > most:
                        most = score
                        shifts[frame, phase, length] = shift
                from_phase = (phase - shifts[frame, phase, length]) % phases
                before[frame, phase, length] = origin[from_phase]
                found[phase, length] = most - np.log(spread) + scores[frame, phase, length]
        best = found
    at = int(np.argmax(best))
    phase, length = at // lengths, at % lengths
    steps, chosen = np.zeros(frames), np.zeros(frames, np.int64)
    for frame in range(frames - 1, 0, -1):
        chosen[frame] = length
        steps[frame] = shifts[frame, phase, length]
        phase, length = (
            (phase - shifts[frame, phase, length]) % phases,
            before[frame, phase, length],
        )
    chosen[0] = length
    steps[0] = phase
    return np.cumsum(steps), chosen
