"""Motion of people on the ground: interacting standing, straight and turning models."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from people4d.messages import F64
from services.predictor.motion_modes import MODES, advance_modes, measure_modes

Integers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

STANDING, STRAIGHT, TURNING = range(3)
POSITION, VELOCITY = range(2)

FIRST = (0.05, 0.6, 0.35)  # initial probabilities of standing, straight, turning
SIGMA_FIRST_MPS = 1.5  # standard deviation of the velocity of a new track, per axis [m/s]
SWAY_MPS = 0.026  # standard deviation of the velocity of a standing person [m/s]
ACCELERATIONS = (0.083, 0.2, 0.5)  # densities of white acceleration, by mode [m/s^2 sqrt(s)]
DECAYS_S = (1.3, 1000.0, 1000.0)  # time constants of the velocity, by mode [s]
# Rates of mode changes [1/s], from rows to columns
CHANGE_RATES_HZ = ((0.0, 0.03, 0.03), (0.001, 0.0, 0.035), (0.01, 1.2, 0.0))


@dataclass(frozen=True)
class MotionEstimate:
    """Motion of N people: one Gaussian of position and velocity for each mode.

    Both axes have the same covariance, since motion and measurement are isotropic.
    """

    positions_m: F64  # Nx3x2, by mode
    velocities_mps: F64  # Nx3x2, by mode
    covariances: F64  # Nx3x2x2, of position and velocity along an axis, by mode
    modes: F64  # Nx3, probability of each mode

    @property
    def position_m(self) -> F64:
        """Expected positions, Nx2."""
        found: F64 = np.einsum("nk,nki->ni", self.modes, self.positions_m)
        return found

    @property
    def velocity_mps(self) -> F64:
        """Expected velocities, Nx2."""
        found: F64 = np.einsum("nk,nki->ni", self.modes, self.velocities_mps)
        return found

    def select_people(self, rows: Integers | Flags) -> "MotionEstimate":
        """Return the motion of a selection of people."""
        parts = (self.positions_m, self.velocities_mps, self.covariances, self.modes)
        return MotionEstimate(*(part[rows] for part in parts))


def initial_motion(positions_m: F64, sigma_m: F64) -> MotionEstimate:
    """Return the motion of new people with positions (Nx2) and standard deviations (N)."""
    count = len(positions_m)
    covariances = np.zeros((count, MODES, 2, 2))
    covariances[:, :, 0, 0] = sigma_m[:, None] ** 2
    covariances[:, STRAIGHT:, 1, 1] = SIGMA_FIRST_MPS**2
    covariances[:, STANDING, 1, 1] = SWAY_MPS**2
    return MotionEstimate(
        positions_m=np.repeat(positions_m[:, None], MODES, axis=1),
        velocities_mps=np.zeros((count, MODES, 2)),
        covariances=covariances,
        modes=np.tile(np.array(FIRST), (count, 1)),
    )


def predict_motion(motion: MotionEstimate, elapsed_s: F64) -> MotionEstimate:
    """Mix the modes and predict over N intervals [s]."""
    rates, sigma = np.array(CHANGE_RATES_HZ), np.array(ACCELERATIONS)
    decay, reach = velocity_decay(elapsed_s[:, None])  # Nx3
    parts = (motion.positions_m, motion.velocities_mps, motion.covariances, motion.modes)
    return MotionEstimate(*advance_modes(*parts, elapsed_s, rates, decay, reach, sigma**2))


def update_motion(motion: MotionEstimate, part: int, values: F64, sigma: F64) -> MotionEstimate:
    """Update with measured positions (part 0) or velocities (part 1).

    Args:
        motion: Predicted motion.
        part: POSITION or VELOCITY.
        values: Nx2 [m or m/s].
        sigma: N standard deviations, per axis.
    """
    parts = (motion.positions_m, motion.velocities_mps, motion.covariances, motion.modes)
    return MotionEstimate(*measure_modes(*parts, part, values, sigma))


def velocity_decay(elapsed_s: F64) -> tuple[F64, F64]:
    """Return the remaining share of velocity, and displacement per velocity [s], by mode."""
    times = np.array(DECAYS_S)
    decay = np.exp(-elapsed_s / times)
    return decay, times * (1 - decay)
