"""Memory of past forecasts: what followed them, and how wide ellipses must be."""

from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from services.predictor.config import MemoryConfig
from services.predictor.habits import weigh_errors
from services.predictor.motion import Flags, Integers
from services.predictor.motion_filter import Samples

CHI2_2DOF_90 = 4.6052
ERROR_MIN_M = 0.005  # [m] smaller errors count alike
SCALE_STEP = 0.3  # largest change of the logarithm of a scale by one message
SCALE_RANGE = (-2.5, 2.0)  # of the logarithm


@dataclass(frozen=True)
class Situation:
    """People at one time, and the forecast of their motion models."""

    ids: Integers  # N
    positions_m: F64  # Nx2
    velocities_mps: F64  # Nx2
    standing: Flags  # N
    displacements_m: F64  # NxHx2, mean of the motion models
    measured_m: F64  # NxHx2, displacements by the measured position and velocity
    covariances_m2: F64  # NxHx2x2, likewise


class ForecastMemory:
    """The last forecasts, and the displacements that followed.

    From all of them comes the share of their displacements that people really make (less than 1 in
    a room, where they turn or stop), from those near by and alike a habit.
    """

    def __init__(self, config: MemoryConfig, horizons_s: F64) -> None:
        self._config, self._horizons_s = config, horizons_s
        size, count = config.size, len(horizons_s)
        self._next, self._filled = 0, 0
        self._ids = np.full(size, -1, np.int64)
        self._times_s = np.full(size, -np.inf)
        self._features = np.zeros((size, 4))
        self._standing = np.zeros(size, bool)
        self._positions_m = np.zeros((size, 2))
        self._expected_m = np.zeros((size, count, 2))  # displacements of the motion models
        self._differ_m = np.zeros((size, count, 2))  # measured ones, less those
        self._means_m = np.zeros((size, count, 2))  # displacements that were published
        self._inverses = np.zeros((size, count, 2, 2))
        self._known = np.zeros((size, count))
        self._true_m = np.zeros((size, count, 2))  # displacements that followed; 0 if unknown
        self._gains = np.ones(count)  # the following: share of the measured motion
        self._measured = np.where(horizons_s <= config.from_s, 1.0, 0.0)
        self._trust = 1 - np.exp(-((horizons_s / config.from_s) ** 4))
        self._errors_m = np.zeros((size, count, 2))
        self._log_scales = np.zeros((2, count)) + np.log(config.scale)[:, None]
        self._scaled = np.zeros((2, count))  # number of errors that they follow from
        self._stored_s: dict[int, float] = {}

    def learn(self, samples: Samples) -> None:
        """Fill in what people did, up to their new samples."""
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
        self._rescale(self._standing[entry].astype(int), horizon, distance2)
        self._compare()

    def _compare(self) -> None:
        """Compare all expected displacements with the true ones."""
        expected_m = self._expected_m[: self._filled]
        known = self._known[: self._filled]
        true_m = self._true_m[: self._filled]
        short = int(np.searchsorted(self._horizons_s, self._config.from_s, side="right"))
        missing_m = true_m[:, :short] - expected_m[:, :short]
        differ_m = self._differ_m[: self._filled, :short]
        weights = known[:, :short] / (np.linalg.norm(missing_m, axis=2) + ERROR_MIN_M)
        better = np.einsum("mhi,mhi,mh->h", missing_m, differ_m, weights)
        different = np.einsum("mhi,mhi,mh->h", differ_m, differ_m, weights)
        prior = self._config.measured_weight * self._horizons_s[:short]
        # Squares weighted so that they stand for absolute errors: few large ones do not decide.
        self._measured[:short] = np.clip((better + prior) / (different + prior), 0, 1)
        expected_m = expected_m + self._measured[:, None] * self._differ_m[: self._filled]
        prior = self._config.gain_weight * self._horizons_s**2
        made = np.einsum("mhi,mhi->h", expected_m, true_m)  # true displacements are 0 if unknown
        asked = np.einsum("mhi,mhi,mh->h", expected_m, expected_m, known)
        share = np.clip((made + prior) / (asked + prior), 0.2, 1.2)
        self._gains = 1 + self._trust * (share - 1)
        expected_m = self._gains[:, None] * expected_m
        self._errors_m[: self._filled] = (true_m - expected_m) * known[..., None]

    def _rescale(self, group: Integers, horizon: Integers, distance2: F64) -> None:
        """Follow the scale of the ellipses that hold 90 %, fast at first [Gibbs 2021]."""
        config = self._config
        missed = distance2 > CHI2_2DOF_90 * np.exp(2 * self._log_scales[group, horizon])
        change = np.zeros_like(self._log_scales)
        np.add.at(change, (group, horizon), missed - 0.1)
        gain = np.maximum(config.scale_gain_first / (1 + self._scaled / 20), config.scale_gain)
        np.add.at(self._scaled, (group, horizon), 1)
        changed = self._log_scales + np.clip(gain * change, -SCALE_STEP, SCALE_STEP)
        self._log_scales = np.clip(changed, *SCALE_RANGE)

    def add(self, now_s: float, ids: Integers, situation: Situation, means_m: F64) -> None:
        """Remember the forecast of those of some people whose last one is old enough."""
        chosen = set(ids.tolist())
        store_s, size = self._config.store_s, self._config.size
        due = [
            number
            for number, key in enumerate(situation.ids.tolist())
            if key in chosen and now_s - self._stored_s.get(key, -np.inf) >= store_s
        ][:size]
        if not due:
            return
        at = (self._next + np.arange(len(due))) % size
        self._next = int(at[-1] + 1) % size
        self._filled = max(self._filled, int(at.max()) + 1)
        self._stored_s.update((int(situation.ids[number]), now_s) for number in due)
        if len(self._stored_s) > size:
            self._stored_s = {k: s for k, s in self._stored_s.items() if now_s - s < 60.0}
        self._ids[at], self._times_s[at] = situation.ids[due], now_s
        self._features[at] = self._normalised(situation)[due]
        self._standing[at] = situation.standing[due]
        self._positions_m[at] = situation.positions_m[due]
        self._expected_m[at], self._means_m[at] = situation.displacements_m[due], means_m[due]
        self._differ_m[at] = situation.measured_m[due] - situation.displacements_m[due]
        self._inverses[at] = np.linalg.inv(situation.covariances_m2[due])
        self._known[at], self._true_m[at], self._errors_m[at] = 0.0, 0.0, 0.0

    def displacements(self, now_s: float, situation: Situation) -> F64:
        """Return expected displacements with the share and the habits learned, NxHx2 [m].

        The errors of a person's own last forecasts are not independent of the present one.
        """
        expected_m = situation.displacements_m
        expected_m = expected_m + self._measured[:, None] * (situation.measured_m - expected_m)
        plain_m = self._gains[:, None] * expected_m
        if not self._filled:
            return plain_m
        past = slice(self._filled)
        total, errors_m = weigh_errors(
            *(situation.ids, self._normalised(situation), now_s, self._config.own_after_s),
            *(self._ids[past], self._times_s[past], self._features[past]),
            *(self._known[past], self._errors_m[past]),
        )
        share = self._trust / (total + self._config.prior_weight)
        found: F64 = plain_m + errors_m * share[..., None]
        return found

    def scales(self, standing: Flags) -> F64:
        """Return the factor of the standard deviations, NxH."""
        found: F64 = np.exp(self._log_scales[standing.astype(int)])
        return found

    def _normalised(self, situation: Situation) -> F64:
        config = self._config
        parts = situation.positions_m / config.near_m, situation.velocities_mps / config.alike_mps
        return np.concatenate(parts, axis=1)
