"""Interacting multiple models: filters in parallel, with transitions between them.

Shapes are written for N tracks with M modes of n state variables: states x (NxMxn), covariances
P (NxMxnxn) and probabilities (NxM). Source: docs/method.md, section 16 [Blom 1988].
"""

from itertools import combinations

import numpy as np

from people4d.messages import F64

PROBABILITY_MIN = 1e-6  # minimum probability of a mode


def mixing_weights(probability: F64, transition: F64) -> tuple[F64, F64]:
    """Return the weights (NxMxM) of all modes in each mode after transitions, and probabilities.

    Element i, j of `transition` (MxM or NxMxM) is the probability of a transition from i to j.
    """
    joint = probability[:, :, None] * transition  # N, from, to
    after = joint.sum(axis=1)
    return (joint / after[:, None]).swapaxes(1, 2), after


def mix(x: F64, P: F64, probability: F64, transition: F64) -> tuple[F64, F64, F64]:
    """Return mixed states, covariances and probabilities of the modes after transitions."""
    weight, after = mixing_weights(probability, transition)
    return *moments(weight, x, P), after


def moments(weight: F64, x: F64, P: F64) -> tuple[F64, F64]:
    """Return means (NxKxn) and covariances of K mixtures (weights NxKxM) of the modes.

    The spread of the modes about their mean is the sum of w_i w_j d d^T over all pairs, d their
    difference.
    """
    modes, n = x.shape[1:]
    within = (weight @ P.reshape(len(P), modes, n * n)).reshape(*weight.shape[:2], n, n)
    for i, j in combinations(range(modes), 2):
        off = x[:, i] - x[:, j]
        spread = (off[:, :, None] * off[:, None])[:, None]
        within = within + (weight[..., i] * weight[..., j])[..., None, None] * spread
    return weight @ x, within


def weighed(probability: F64, d_m2: F64, log_det: F64) -> F64:
    """Return the probabilities of modes weighed by the likelihoods from d_M^2 and ln |S| (NxM)."""
    logs = -0.5 * (d_m2 + log_det)
    greatest = np.maximum.reduce(logs, axis=1, keepdims=True)
    weight = normalised(probability * np.exp(logs - greatest))
    return normalised(np.maximum(weight, PROBABILITY_MIN))


def normalised(weights: F64) -> F64:
    """Return weights (NxM) divided by their sums."""
    result: F64 = weights / np.add.reduce(weights, axis=1, keepdims=True)
    return result
