"""Mixing, prediction and update of the modes of motion, compiled."""

import math

import numpy as np

from common.compiled import compiled
from people4d.messages import F64

MODES = 3
MODE_MIN = 1e-6  # minimum probability of a mode


@compiled
def advance_modes(
    positions_m: F64,
    velocities_mps: F64,
    covariances: F64,
    modes: F64,
    elapsed_s: F64,
    rates: F64,
    decay: F64,
    reach: F64,
    noise: F64,
) -> tuple[F64, F64, F64, F64]:
    """Mix the modes by their transition probabilities [Blom 1988], and predict.

    Args:
        positions_m: Nx3x2, by mode [m].
        velocities_mps: Nx3x2 [m/s].
        covariances: Nx3x2x2 of position and velocity along an axis.
        modes: Nx3 probabilities.
        elapsed_s: N times [s].
        rates: 3x3 rates of changes from and to modes [1/s], 0 on the diagonal.
        decay: Nx3 remaining share of velocity.
        reach: Nx3 displacement per velocity [s].
        noise: 3 squared densities of the acceleration [m^2/s^3].

    Returns:
        Positions, velocities, covariances and modes, in the shapes of the arguments.
    """
    p, v = np.zeros_like(positions_m), np.zeros_like(velocities_mps)
    c, w = np.zeros_like(covariances), np.zeros_like(modes)
    joint = np.zeros((MODES, MODES))
    for n in range(len(modes)):
        t = elapsed_s[n]
        for i in range(MODES):
            leave = rates[i].sum()
            stay = math.exp(-leave * t)
            for j in range(MODES):
                change = stay if i == j else (1 - stay) * rates[i, j] / max(leave, 1e-12)
                joint[i, j] = modes[n, i] * change
        for j in range(MODES):
            w[n, j] = joint[0, j] + joint[1, j] + joint[2, j]
            px = py = vx = vy = 0.0
            for i in range(MODES):
                weight = joint[i, j] / w[n, j]
                px += weight * positions_m[n, i, 0]
                py += weight * positions_m[n, i, 1]
                vx += weight * velocities_mps[n, i, 0]
                vy += weight * velocities_mps[n, i, 1]
            cpp = cpv = cvv = 0.0
            for i in range(MODES):  # the spread is the mean of both axes
                weight = joint[i, j] / w[n, j]
                dpx, dpy = positions_m[n, i, 0] - px, positions_m[n, i, 1] - py
                dvx, dvy = velocities_mps[n, i, 0] - vx, velocities_mps[n, i, 1] - vy
                cpp += weight * (covariances[n, i, 0, 0] + (dpx * dpx + dpy * dpy) / 2)
                cpv += weight * (covariances[n, i, 0, 1] + (dpx * dvx + dpy * dvy) / 2)
                cvv += weight * (covariances[n, i, 1, 1] + (dvx * dvx + dvy * dvy) / 2)
            d, r, q = decay[n, j], reach[n, j], noise[j]
            p[n, j, 0], p[n, j, 1] = px + r * vx, py + r * vy
            v[n, j, 0], v[n, j, 1] = d * vx, d * vy
            c[n, j, 0, 0] = cpp + 2 * r * cpv + r * r * cvv + q * t**3 / 3
            c[n, j, 0, 1] = c[n, j, 1, 0] = d * (cpv + r * cvv) + q * t * t / 2
            c[n, j, 1, 1] = d * d * cvv + q * t
    return p, v, c, w


@compiled
def measure_modes(
    positions_m: F64,
    velocities_mps: F64,
    covariances: F64,
    modes: F64,
    part: int,
    values: F64,
    sigma: F64,
) -> tuple[F64, F64, F64, F64]:
    """Update with positions (part 0) or velocities (part 1), Nx2, of N standard deviations.

    Returns:
        Positions, velocities, covariances and modes, in the shapes of the arguments.
    """
    p, v = positions_m.copy(), velocities_mps.copy()
    c, w = covariances.copy(), np.zeros_like(modes)
    for n in range(len(modes)):
        for j in range(MODES):
            before = positions_m[n, j] if part == 0 else velocities_mps[n, j]
            x, y = values[n, 0] - before[0], values[n, 1] - before[1]
            s = covariances[n, j, part, part] + sigma[n] ** 2
            gain_p, gain_v = covariances[n, j, part, 0] / s, covariances[n, j, part, 1] / s
            w[n, j] = math.log(modes[n, j]) - math.log(s) - (x * x + y * y) / (2 * s)
            p[n, j, 0] += gain_p * x
            p[n, j, 1] += gain_p * y
            v[n, j, 0] += gain_v * x
            v[n, j, 1] += gain_v * y
            for k in range(2):
                c[n, j, 0, k] -= gain_p * covariances[n, j, part, k]
                c[n, j, 1, k] -= gain_v * covariances[n, j, part, k]
        w[n] = np.exp(w[n] - w[n].max())
        w[n] = np.maximum(w[n] / w[n].sum(), MODE_MIN)
        w[n] /= w[n].sum()
    return p, v, c, w
