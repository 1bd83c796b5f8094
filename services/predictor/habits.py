"""Errors of past forecasts in similar situations, compiled."""

import math

import numpy as np

from common.compiled import compiled
from people4d.messages import F64
from services.predictor.motion import Integers

FAR = 36.0  # maximum squared normalised distance of a similar situation


@compiled
def weigh_errors(
    ids: Integers,
    features: F64,
    now_s: float,
    own_after_s: float,
    past_ids: Integers,
    past_times_s: F64,
    past_features: F64,
    known: F64,
    errors_m: F64,
) -> tuple[F64, F64]:
    """Return sums of weights (NxH) and of weighted errors (NxHx2) by a normal kernel.

    Forecasts of the same person in the last `own_after_s` have no weight.

    Args:
        ids: N people.
        features: NxF, in standard deviations of the kernel.
        now_s: Present time [s].
        own_after_s: Minimum age of forecasts of the same person [s].
        past_ids: M past forecasts.
        past_times_s: M [s].
        past_features: MxF.
        known: MxH, 1 if the true displacement is known, else 0.
        errors_m: MxHx2, 0 if unknown.
    """
    count, size = len(ids), known.shape[1]
    total, errors = np.zeros((count, size)), np.zeros((count, size, 2))
    for n in range(count):
        for m in range(len(past_ids)):
            distance2 = 0.0
            for f in range(features.shape[1]):
                distance2 += (features[n, f] - past_features[m, f]) ** 2
            own = past_ids[m] == ids[n] and now_s - past_times_s[m] < own_after_s
            if own or distance2 > FAR:
                continue
            weight = math.exp(-distance2 / 2)
            for h in range(size):
                total[n, h] += weight * known[m, h]
                errors[n, h, 0] += weight * errors_m[m, h, 0]
                errors[n, h, 1] += weight * errors_m[m, h, 1]
    return total, errors
