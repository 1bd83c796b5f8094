"""Memory of past forecasts: their true displacements, and the scale of the ellipses."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from people4d.messages import F64
from services.predictor.motion import Flags, Integers
from services.predictor.motion_filter import Samples

SIZE = 1500  # number of stored forecasts
STORE_S = 0.8  # minimum interval between two stored forecasts of a person [s]
NEAR_M, ALIKE_MPS = 1.0, 0.2  # standard deviations of the kernel [m, m/s]
PRIOR_WEIGHT = 5.0  # prior weight of forecasts without a habit
MEASURED_WEIGHT = 4.0  # prior weight of the measured motion [m/s]
GAIN_WEIGHT = 5.0  # prior weight of a share of 1, as people at 1 m/s
FROM_S = 1.0  # minimum horizon of habits, and maximum horizon of the measured motion [s]
OWN_AFTER_S = 10.0  # minimum age of forecasts of the same person [s]
SCALE = (1.3, 1.0)  # initial scale of standard deviations: walking, standing
SCALE_GAIN_FIRST, SCALE_GAIN = 0.5, 0.03  # first and minimum gain of the logarithm of a scale
CHI2_2DOF_90 = 4.6052
FAR = 36.0  # maximum squared distance of a similar situation, in standard deviations
ERROR_MIN_M = 0.005  # error added to each error in the weights [m]
SCALE_STEP = 0.3  # maximum change of the logarithm of a scale by one message
SCALE_RANGE = (-2.5, 2.0)  # range of the logarithm of a scale


@dataclass(frozen=True)
class Situation:
    """People at one time, with the forecasts of their motion models."""

    ids: Integers  # N
    positions_m: F64  # Nx2
    velocities_mps: F64  # Nx2
    standing: Flags  # N
    displacements_m: F64  # NxHx2, mean of the motion models
    measured_m: F64  # NxHx2, displacements from measured position and velocity
    covariances_m2: F64  # NxHx2x2, covariances of the motion models


class ForecastMemory:
    """Recent forecasts and their true displacements.

    All forecasts give the ratio of true to expected displacements, below 1 in a room, since people
    turn or stop. Forecasts at a similar position and velocity give a habit: their mean error.
    """

    def __init__(self, horizons_s: F64) -> None:
        self._horizons_s = horizons_s
        size, count = SIZE, len(horizons_s)
        self._next, self._filled = 0, 0
        self._ids = np.full(size, -1, np.int64)
        self._times_s = np.full(size, -np.inf)
        self._features = np.zeros((size, 4))
        self._standing = np.zeros(size, bool)
        self._positions_m = np.zeros((size, 2))
        self._expected_m = np.zeros((size, count, 2))  # displacements of the motion models
        self._differ_m = np.zeros((size, count, 2))  # measured minus expected displacements
        self._means_m = np.zeros((size, count, 2))  # published displacements
        self._inverses = np.zeros((size, count, 2, 2))
        self._known = np.zeros((size, count))
        self._true_m = np.zeros((size, count, 2))  # true displacements; 0 if unknown
        self._gains = np.ones(count)  # ratios of true to expected displacements
        self._measured = np.where(horizons_s <= FROM_S, 1.0, 0.0)  # shares of the measured motion
        self._trust = 1 - np.exp(-((horizons_s / FROM_S) ** 4))
        self._errors_m = np.zeros((size, count, 2))
        self._log_scales = np.zeros((2, count)) + np.log(SCALE)[:, None]
        self._scaled = np.zeros((2, count))  # number of errors used for each scale
        self._stored_s: dict[int, float] = {}

    def add_samples(self, samples: Samples) -> None:
        """Store the true displacements up to new samples."""
        newest_s = samples.now_s
        open_ = np.flatnonzero(self._times_s >= newest_s - self._horizons_s[-1] - 2.0)
        if not len(samples.ids) or not len(open_):
            return
        order = np.argsort(samples.ids)
        at = np.searchsorted(samples.ids, self._ids[open_], sorter=order)
        at = order[np.minimum(at, len(order) - 1)]
        mine = samples.ids[at] == self._ids[open_]
        open_, at = open_[mine], at[mine]
        times_s = self._times_s[open_, None] + self._horizons_s
        due = (times_s > samples.before_s[at][:, None]) & (times_s <= newest_s + 1e-6)
        row, horizon = np.nonzero(due)
        if not len(row):
            return
        person, entry = at[row], open_[row]
        elapsed_s = newest_s - samples.before_s[person]
        weight = (times_s[row, horizon] - samples.before_s[person]) / elapsed_s
        start_m, end_m = samples.before_m[person], samples.now_m[person]
        true_m = start_m + weight[:, None] * (end_m - start_m) - self._positions_m[entry]
        self._true_m[entry, horizon] = true_m
        self._known[entry, horizon] = 1.0
        error_m = true_m - self._means_m[entry, horizon]
        distance2 = np.einsum("ki,kij,kj->k", error_m, self._inverses[entry, horizon], error_m)
        self._update_scales(self._standing[entry].astype(int), horizon, distance2)
        self._compare_displacements()

    def _compare_displacements(self) -> None:
        """Compare all expected displacements with the true displacements."""
        expected_m = self._expected_m[: self._filled]
        known = self._known[: self._filled]
        true_m = self._true_m[: self._filled]
        short = int(np.searchsorted(self._horizons_s, FROM_S, side="right"))
        missing_m = true_m[:, :short] - expected_m[:, :short]
        differ_m = self._differ_m[: self._filled, :short]
        weights = known[:, :short] / (np.linalg.norm(missing_m, axis=2) + ERROR_MIN_M)
        better = np.einsum("mhi,mhi,mh->h", missing_m, differ_m, weights)
        different = np.einsum("mhi,mhi,mh->h", differ_m, differ_m, weights)
        prior = MEASURED_WEIGHT * self._horizons_s[:short]
        # Weighted squares stand for absolute errors, robust against a few large errors.
        self._measured[:short] = np.clip((better + prior) / (different + prior), 0, 1)
        expected_m = expected_m + self._measured[:, None] * self._differ_m[: self._filled]
        prior = GAIN_WEIGHT * self._horizons_s**2
        made = np.einsum("mhi,mhi->h", expected_m, true_m)  # true displacements are 0 if unknown
        asked = np.einsum("mhi,mhi,mh->h", expected_m, expected_m, known)
        share = np.clip((made + prior) / (asked + prior), 0.2, 1.2)
        self._gains = 1 + self._trust * (share - 1)
        expected_m = self._gains[:, None] * expected_m
        self._errors_m[: self._filled] = (true_m - expected_m) * known[..., None]

    def _update_scales(self, group: Integers, horizon: Integers, distance2: F64) -> None:
        """Update the scale of the 90 % ellipses, fast at first [Gibbs 2021]."""
        missed = distance2 > CHI2_2DOF_90 * np.exp(2 * self._log_scales[group, horizon])
        change = np.zeros_like(self._log_scales)
        np.add.at(change, (group, horizon), missed - 0.1)
        gain = np.maximum(SCALE_GAIN_FIRST / (1 + self._scaled / 20), SCALE_GAIN)
        np.add.at(self._scaled, (group, horizon), 1)
        changed = self._log_scales + np.clip(gain * change, -SCALE_STEP, SCALE_STEP)
        self._log_scales = np.clip(changed, *SCALE_RANGE)

    def add_forecasts(
        self, now_s: float, ids: Integers, situation: Situation, means_m: F64
    ) -> None:
        """Store forecasts at intervals of at least STORE_S for each person."""
        chosen = set(ids.tolist())
        due = [
            number
            for number, key in enumerate(situation.ids.tolist())
            if key in chosen and now_s - self._stored_s.get(key, -np.inf) >= STORE_S
        ][:SIZE]
        if not due:
            return
        at = (self._next + np.arange(len(due))) % SIZE
        self._next = int(at[-1] + 1) % SIZE
        self._filled = max(self._filled, int(at.max()) + 1)
        self._stored_s.update((int(situation.ids[number]), now_s) for number in due)
        if len(self._stored_s) > SIZE:
            self._stored_s = {k: s for k, s in self._stored_s.items() if now_s - s < 60.0}
        self._ids[at], self._times_s[at] = situation.ids[due], now_s
        self._features[at] = _features(situation)[due]
        self._standing[at] = situation.standing[due]
        self._positions_m[at] = situation.positions_m[due]
        self._expected_m[at], self._means_m[at] = situation.displacements_m[due], means_m[due]
        self._differ_m[at] = situation.measured_m[due] - situation.displacements_m[due]
        self._inverses[at] = np.linalg.inv(situation.covariances_m2[due])
        self._known[at], self._true_m[at], self._errors_m[at] = 0.0, 0.0, 0.0

    def displacements(self, now_s: float, situation: Situation) -> F64:
        """Return expected displacements corrected by shares and habits, NxHx2 [m].

        Recent forecasts of the same person are excluded: the errors are correlated.
        """
        expected_m = situation.displacements_m
        expected_m = expected_m + self._measured[:, None] * (situation.measured_m - expected_m)
        plain_m = self._gains[:, None] * expected_m
        if not self._filled:
            return plain_m
        past = slice(self._filled)
        distance2 = cdist(_features(situation), self._features[past], "sqeuclidean")
        used = situation.ids[:, None] != self._ids[past]
        used |= now_s - self._times_s[past] >= OWN_AFTER_S
        used &= distance2 <= FAR
        weights = np.zeros_like(distance2)
        weights[used] = np.exp(distance2[used] / -2)
        errors_m = weights @ self._errors_m[past].reshape(self._filled, -1)
        share = self._trust / (weights @ self._known[past] + PRIOR_WEIGHT)
        found: F64 = plain_m + errors_m.reshape(plain_m.shape) * share[..., None]
        return found

    def scales(self, standing: Flags) -> F64:
        """Return the scales of the standard deviations, NxH."""
        found: F64 = np.exp(self._log_scales[standing.astype(int)])
        return found


def _features(situation: Situation) -> F64:
    """Return position and velocity in standard deviations of the kernel, Nx4."""
    parts = situation.positions_m / NEAR_M, situation.velocities_mps / ALIKE_MPS
    return np.concatenate(parts, axis=1)
