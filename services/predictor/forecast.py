"""Forecast of people on the ground: mean and covariance at each horizon."""

from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from services.predictor.groups import GroupFinder
from services.predictor.memory import ForecastMemory, Situation
from services.predictor.mixtures import integrate_motion, mix_modes, unit_samples
from services.predictor.motion import STANDING, Integers, velocity_decay
from services.predictor.motion_filter import MotionFilter, TrackedMotion

MOTION_HORIZON_S = 3.0  # horizon of the probabilities of motion [s]
# Ratio of the displacement of a group in the displacement of its members, and the horizon [s] from
# which it applies: single steps are individual
COHESION, COHESION_FROM_S = 0.6, 1.0
ACCELERATIONS = (0.1, 0.2, 0.6)  # densities of white acceleration in forecasts [m/s^2 sqrt(s)]
UNIT_SAMPLES = unit_samples()


@dataclass(frozen=True)
class PeopleState:
    """Tracks of N people at one time."""

    ids: Integers  # N identities
    positions_m: F64  # Nx2
    velocities_mps: F64  # Nx2
    covariances_m2: F64  # Nx2x2, of positions
    sigma_mps: F64  # N, standard deviation of a velocity, per axis
    yaws_rad: F64  # N, NaN if unknown

    def tracked(self) -> TrackedMotion:
        """Return positions and velocities as measurements."""
        variances = self.covariances_m2[:, (0, 1), (0, 1)].mean(axis=1)
        velocities = self.velocities_mps, self.sigma_mps
        return TrackedMotion(self.ids, self.positions_m, np.sqrt(variances), *velocities)


@dataclass(frozen=True)
class Forecast:
    """Future of N people at H horizons."""

    velocities_mps: F64  # Nx2, at present
    means_m: F64  # NxHx2
    covariances_m2: F64  # NxHx2x2
    motion: F64  # Nx3, probabilities of standing, going on and turning
    groups: Integers  # N, number of the group, 0: none


class Forecaster:
    """Forecasts all people from their tracks."""

    def __init__(self, horizons_s: F64) -> None:
        self._horizons_s = horizons_s
        self._filter = MotionFilter()
        self._memory = ForecastMemory(horizons_s)
        self._groups = GroupFinder()
        self._cohesion = COHESION * (1 - np.exp(-((horizons_s / COHESION_FROM_S) ** 2)))
        # Displacement per velocity [s], by mode and horizon
        self._reach = np.ascontiguousarray(velocity_decay(horizons_s[:, None])[1].T)
        self._noise = np.array(ACCELERATIONS) ** 2

    def forecast_people(self, now_s: float, people: PeopleState) -> Forecast:
        """Return the forecast of people tracked at a time [s]."""
        motion, measured_mps, samples = self._filter.add_tracks(now_s, people.tracked())
        self._memory.add_samples(samples)
        position_m, velocity_mps = motion.position_m, motion.velocity_mps
        groups = self._groups.find_groups(
            now_s, people.ids, position_m, velocity_mps, people.yaws_rad
        )
        expected_m, covariances_m2 = mix_modes(
            *(motion.positions_m, motion.velocities_mps, motion.covariances, motion.modes),
            *(self._horizons_s, self._reach, self._noise),
        )
        displacements_m = expected_m - position_m[:, None]
        situation = Situation(
            ids=people.ids,
            positions_m=position_m,
            velocities_mps=velocity_mps,
            standing=motion.modes[:, STANDING] > 0.5,
            displacements_m=apply_cohesion(displacements_m, groups, self._cohesion),
            measured_m=(people.positions_m - position_m)[:, None]
            + self._horizons_s[:, None] * measured_mps[:, None],
            covariances_m2=covariances_m2,
        )
        displacements_m = self._memory.displacements(now_s, situation)
        if len(samples.ids):
            settled = samples.ids[samples.settled]
            self._memory.add_forecasts(now_s, settled, situation, displacements_m)
        scales = self._memory.scales(situation.standing)[..., None, None]
        covariances_m2 = covariances_m2 * scales**2 + people.covariances_m2[:, None]
        probabilities = motion_probabilities(
            velocity_mps, displacements_m, covariances_m2, self._horizons_s
        )
        means_m = position_m[:, None] + displacements_m
        return Forecast(velocity_mps, means_m, covariances_m2, probabilities, groups)


def apply_cohesion(displacements_m: F64, groups: Integers, cohesion: F64) -> F64:
    """Move displacements (NxHx2) of group members towards their mean, by shares (H)."""
    if not groups.any():
        return displacements_m
    numbers, rows = np.unique(groups, return_inverse=True)
    sums = np.zeros((len(numbers), *displacements_m.shape[1:]))
    np.add.at(sums, rows, displacements_m)
    means = sums / np.maximum(np.bincount(rows, minlength=len(numbers)), 1)[:, None, None]
    share = (groups > 0)[:, None, None] * cohesion[:, None]
    return displacements_m + share * (means[rows] - displacements_m)


def motion_probabilities(
    velocities_mps: F64, displacements_m: F64, covariances_m2: F64, horizons_s: F64
) -> F64:
    """Integrate the forecast (NxHx2, NxHx2x2) at about 3 s over the regions of motion, Nx3."""
    at = int(np.argmin(np.abs(horizons_s - MOTION_HORIZON_S)))
    mean_m = np.ascontiguousarray(displacements_m[:, at])
    covariance_m2 = np.ascontiguousarray(covariances_m2[:, at])
    return integrate_motion(velocities_mps, mean_m, covariance_m2, UNIT_SAMPLES)
