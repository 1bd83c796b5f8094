"""Forecast of people on the ground: mean and covariance at each horizon."""

import math
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from services.predictor.groups import GroupFinder
from services.predictor.memory import ForecastMemory, Situation
from services.predictor.motion import (
    POSITION,
    STANDING,
    VELOCITY,
    Integers,
    MotionEstimate,
    velocity_decay,
)
from services.predictor.motion_filter import MotionFilter, TrackedMotion

MOTION_HORIZON_S = 3.0  # horizon of the probabilities of motion [s]
# Share of the group's displacement in the displacement of a member, and its minimum horizon [s]
COHESION, COHESION_FROM_S = 0.6, 1.0
ACCELERATIONS = (0.1, 0.2, 0.6)  # densities of white acceleration in forecasts [m/s^2 sqrt(s)]
STANDING_RADIUS_M = 0.6  # maximum displacement of a standing person [m]
GOING_ON_RAD = math.radians(25.0)  # maximum change of direction of a person who continues [rad]
SAMPLES = 64  # number of points of the normal distribution


@dataclass(frozen=True)
class PeopleState:
    """Tracks of N people at one time."""

    ids: Integers  # N identities
    positions_m: F64  # Nx2
    velocities_mps: F64  # Nx2
    covariances_m2: F64  # Nx2x2, covariances of positions
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

    velocities_mps: F64  # Nx2, velocities at the stamp
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
        # Displacement per velocity [s], by horizon and mode
        self._reach = velocity_decay(horizons_s[:, None])[1]  # Hx3
        # Variance of the position by white acceleration, Hx3 [m^2]
        self._noise_m2 = np.array(ACCELERATIONS) ** 2 * horizons_s[:, None] ** 3 / 3
        self._samples = unit_samples()

    def forecast_people(self, now_s: float, people: PeopleState) -> Forecast:
        """Return the forecast of people tracked at a time [s]."""
        motion, measured_mps, samples = self._filter.add_tracks(now_s, people.tracked())
        self._memory.add_samples(samples)
        position_m, velocity_mps = motion.position_m, motion.velocity_mps
        groups = self._groups.find_groups(
            now_s, people.ids, position_m, velocity_mps, people.yaws_rad
        )
        expected_m, covariances_m2 = self._mix_modes(motion)
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
        at = int(np.argmin(np.abs(self._horizons_s - MOTION_HORIZON_S)))
        probabilities = motion_probabilities(
            velocity_mps, displacements_m[:, at], covariances_m2[:, at], self._samples
        )
        means_m = position_m[:, None] + displacements_m
        return Forecast(velocity_mps, means_m, covariances_m2, probabilities, groups)

    def _mix_modes(self, motion: MotionEstimate) -> tuple[F64, F64]:
        """Return mean (NxHx2) and covariance (NxHx2x2) of all modes at the horizons."""
        reach, states = self._reach, motion.states[:, None]  # Hx3, Nx1x3x2x2
        positions_m = states[..., POSITION] + reach[:, :, None] * states[..., VELOCITY]
        means_m = np.einsum("nj,nhja->nha", motion.modes, positions_m)
        off_m, C = positions_m - means_m[:, :, None], motion.covariances[:, None]
        variances_m2 = C[..., 0, 0] + 2 * reach * C[..., 0, 1] + reach**2 * C[..., 1, 1]
        within_m2 = np.einsum("nj,nhj->nh", motion.modes, variances_m2 + self._noise_m2)
        squares_m2 = off_m[..., :, None] * off_m[..., None, :]
        spread_m2 = np.einsum("nj,nhjab->nhab", motion.modes, squares_m2)
        return means_m, within_m2[..., None, None] * np.eye(2) + spread_m2


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
    velocities_mps: F64, displacements_m: F64, covariances_m2: F64, samples: F64
) -> F64:
    """Integrate normal distributions over the regions of standing, going on and turning.

    Args:
        velocities_mps: Nx2, present velocities.
        displacements_m: Nx2 means.
        covariances_m2: Nx2x2.
        samples: 2xS points of a standard normal distribution.

    Returns:
        Nx3 probabilities: within 0.6 m; outside, within 25 deg of the velocity; elsewhere.
    """
    xx, xy, yy = (covariances_m2[:, i, j, None] for i, j in ((0, 0), (0, 1), (1, 1)))
    root, rest = np.sqrt(xx), np.sqrt(np.maximum(yy - xy * xy / xx, 0.0))
    x = displacements_m[:, :1] + root * samples[0]
    y = displacements_m[:, 1:] + xy / root * samples[0] + rest * samples[1]
    distance_m, (v_x, v_y) = np.sqrt(x * x + y * y), velocities_mps.T[..., None]
    standing = distance_m < STANDING_RADIUS_M
    least = math.cos(GOING_ON_RAD) * np.hypot(v_x, v_y)
    going_on = ~standing & (x * v_x + y * v_y > least * distance_m)
    regions = standing, going_on, ~(standing | going_on)
    return np.stack([region.mean(axis=1) for region in regions], axis=1)


def unit_samples() -> F64:
    """Return 2xS points of a standard normal distribution, on a spiral of equal probabilities."""
    number = np.arange(SAMPLES) + 0.5
    radius = np.sqrt(-2 * np.log(1 - number / SAMPLES))
    angle = number * np.pi * (3 - np.sqrt(5))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)])
