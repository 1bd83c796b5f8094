"""Mixtures of the modes of motion at the horizons, compiled."""

import math

import numpy as np

from common.compiled import compiled
from people4d.messages import F64
from services.predictor.motion_modes import MODES

STANDING_RADIUS_M = 0.6  # maximum displacement of a standing person [m]
GOING_ON_RAD = math.radians(25.0)  # maximum change of direction of a person going on [rad]
SAMPLES = 64  # number of points of the normal distribution


@compiled
def mix_modes(
    positions_m: F64,
    velocities_mps: F64,
    covariances: F64,
    modes: F64,
    horizons_s: F64,
    reach: F64,
    noise: F64,
) -> tuple[F64, F64]:
    """Return mean (NxHx2) and covariance (NxHx2x2) of all modes together.

    Args:
        positions_m: Nx3x2, by mode [m].
        velocities_mps: Nx3x2 [m/s].
        covariances: Nx3x2x2 of position and velocity along an axis.
        modes: Nx3 probabilities.
        horizons_s: H [s].
        reach: 3xH displacement per velocity [s].
        noise: 3 squared densities of the acceleration [m^2/s^3].
    """
    count, size = len(modes), len(horizons_s)
    means, found = np.zeros((count, size, 2)), np.zeros((count, size, 2, 2))
    for n in range(count):
        for h in range(size):
            x = y = variance = 0.0
            for j in range(MODES):
                r, w, c = reach[j, h], modes[n, j], covariances[n, j]
                x += w * (positions_m[n, j, 0] + r * velocities_mps[n, j, 0])
                y += w * (positions_m[n, j, 1] + r * velocities_mps[n, j, 1])
                grown = noise[j] * horizons_s[h] ** 3 / 3
                variance += w * (c[0, 0] + 2 * r * c[0, 1] + r * r * c[1, 1] + grown)
            xx = yy = variance
            xy = 0.0
            for j in range(MODES):
                r, w = reach[j, h], modes[n, j]
                dx = positions_m[n, j, 0] + r * velocities_mps[n, j, 0] - x
                dy = positions_m[n, j, 1] + r * velocities_mps[n, j, 1] - y
                xx += w * dx * dx
                xy += w * dx * dy
                yy += w * dy * dy
            means[n, h, 0], means[n, h, 1] = x, y
            found[n, h, 0, 0], found[n, h, 1, 1] = xx, yy
            found[n, h, 0, 1] = found[n, h, 1, 0] = xy
    return means, found


@compiled
def integrate_motion(
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
    count, size = len(velocities_mps), samples.shape[1]
    found = np.zeros((count, 3))
    for n in range(count):
        xx, xy, yy = covariances_m2[n, 0, 0], covariances_m2[n, 0, 1], covariances_m2[n, 1, 1]
        root = math.sqrt(xx)
        rest = math.sqrt(max(yy - xy * xy / xx, 0.0))
        vx, vy = velocities_mps[n, 0], velocities_mps[n, 1]
        least = math.cos(GOING_ON_RAD) * math.hypot(vx, vy)
        for s in range(size):
            x = displacements_m[n, 0] + root * samples[0, s]
            y = displacements_m[n, 1] + xy / root * samples[0, s] + rest * samples[1, s]
            distance = math.sqrt(x * x + y * y)
            if distance < STANDING_RADIUS_M:
                found[n, 0] += 1
            elif x * vx + y * vy > least * distance:
                found[n, 1] += 1
            else:
                found[n, 2] += 1
    found /= size
    return found


def unit_samples() -> F64:
    """Return 2xS points of a standard normal distribution, on a spiral of equal probabilities."""
    number = np.arange(SAMPLES) + 0.5
    radius = np.sqrt(-2 * np.log(1 - number / SAMPLES))
    angle = number * np.pi * (3 - np.sqrt(5))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)])
