"""Motion of people on the ground: interacting standing, straight and turning models."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from people4d.messages import F64
from services.predictor.config import PedestrianConfig
from services.predictor.motion_modes import MODES, advance_modes, measure_modes

Integers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

STANDING, STRAIGHT, TURNING = range(3)
POSITION, VELOCITY = range(2)


@dataclass(frozen=True)
class MotionEstimate:
    """Motion of N people: one Gaussian of position and velocity for each mode.

    Both axes have the same covariance: neither motion nor measurement prefers a direction.
    """

    positions_m: F64  # Nx3x2, by mode
    velocities_mps: F64  # Nx3x2, by mode
    covariances: F64  # Nx3x2x2 of position and velocity along an axis, by mode
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

    def at(self, rows: Integers | Flags) -> "MotionEstimate":
        """Return the motion of some of the people."""
        parts = (self.positions_m, self.velocities_mps, self.covariances, self.modes)
        return MotionEstimate(*(part[rows] for part in parts))


def begin(positions_m: F64, sigma_m: F64, config: PedestrianConfig) -> MotionEstimate:
    """Return the motion of people of whom only a position is known (Nx2, N)."""
    count = len(positions_m)
    covariances = np.zeros((count, MODES, 2, 2))
    covariances[:, :, 0, 0] = sigma_m[:, None] ** 2
    covariances[:, STRAIGHT:, 1, 1] = config.sigma_first_mps**2
    covariances[:, STANDING, 1, 1] = config.sway_mps**2
    return MotionEstimate(
        positions_m=np.repeat(positions_m[:, None], MODES, axis=1),
        velocities_mps=np.zeros((count, MODES, 2)),
        covariances=covariances,
        modes=np.tile(np.array(config.first), (count, 1)),
    )


def advance(motion: MotionEstimate, elapsed_s: F64, config: PedestrianConfig) -> MotionEstimate:
    """Mix and predict over N times [s]."""
    rates = np.array(config.change_rates_hz)
    rates -= np.diag(np.diag(rates))  # 3x3 from, to; the diagonal is not used
    decay, reach = decays(elapsed_s[:, None], config)  # Nx3
    sigma = np.array([config.sway_mps2, config.straight_mps2, config.turning_mps2])
    parts = (motion.positions_m, motion.velocities_mps, motion.covariances, motion.modes)
    return MotionEstimate(*advance_modes(*parts, elapsed_s, rates, decay, reach, sigma**2))


def measure(motion: MotionEstimate, part: int, values: F64, sigma: F64) -> MotionEstimate:
    """Update with measured positions (part 0) or velocities (part 1).

    Args:
        motion: Predicted motion.
        part: POSITION or VELOCITY.
        values: Nx2 [m or m/s].
        sigma: N standard deviations, per axis.
    """
    parts = (motion.positions_m, motion.velocities_mps, motion.covariances, motion.modes)
    return MotionEstimate(*measure_modes(*parts, part, values, sigma))


def decays(elapsed_s: F64, config: PedestrianConfig) -> tuple[F64, F64]:
    """Return share of the velocity left, and displacement per velocity [s], of each mode."""
    times = np.array([config.standing_decay_s, config.straight_decay_s, config.turning_decay_s])
    decay = np.exp(-elapsed_s / times)
    return decay, times * (1 - decay)
