"""Motion of people on the ground: interacting standing, straight and turning models."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common import imm
from people4d.messages import F64

Integers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

STANDING, STRAIGHT, TURNING = range(3)
POSITION, VELOCITY = range(2)

FIRST = (0.05, 0.6, 0.35)  # initial probabilities of standing, straight, turning
SIGMA_FIRST_MPS = 1.5  # standard deviation of the velocity of a new track, per axis [m/s]
SWAY_MPS = 0.026  # standard deviation of the velocity of a standing person [m/s]
ACCELERATIONS = np.array(
    [0.083, 0.2, 0.5]
)  # densities of white acceleration, by mode [m/s^2 sqrt(s)]
DECAYS_S = np.array([1.3, 1000.0, 1000.0])  # time constants of the velocity, by mode [s]
# Rates of mode changes [1/s], from rows to columns
CHANGE_RATES_HZ = np.array([[0.0, 0.03, 0.03], [0.001, 0.0, 0.035], [0.01, 1.2, 0.0]])


@dataclass(frozen=True)
class MotionEstimate:
    """Motion of N people: one Gaussian of position and velocity for each mode.

    Both axes have the same covariance, since motion and measurement are isotropic.
    """

    states: F64  # Nx3x2x2: mode, axis, position and velocity
    covariances: F64  # Nx3x2x2, of position and velocity along an axis, by mode
    modes: F64  # Nx3, probability of each mode

    @property
    def position_m(self) -> F64:
        """Expected positions, Nx2."""
        return self._expected(POSITION)

    @property
    def velocity_mps(self) -> F64:
        """Expected velocities, Nx2."""
        return self._expected(VELOCITY)

    def select_people(self, rows: Integers | Flags) -> "MotionEstimate":
        """Return the motion of a selection of people."""
        return MotionEstimate(self.states[rows], self.covariances[rows], self.modes[rows])

    def _expected(self, part: int) -> F64:
        found: F64 = np.einsum("nk,nki->ni", self.modes, self.states[..., part])
        return found


def initial_motion(positions_m: F64, sigma_m: F64) -> MotionEstimate:
    """Return the motion of new people with positions (Nx2) and standard deviations (N)."""
    count, modes = len(positions_m), len(FIRST)
    states = np.zeros((count, modes, 2, 2))
    states[..., POSITION] = positions_m[:, None]
    covariances = np.zeros((count, modes, 2, 2))
    covariances[:, :, 0, 0] = sigma_m[:, None] ** 2
    covariances[:, STRAIGHT:, 1, 1] = SIGMA_FIRST_MPS**2
    covariances[:, STANDING, 1, 1] = SWAY_MPS**2
    return MotionEstimate(states, covariances, np.tile(np.array(FIRST), (count, 1)))


def predict_motion(motion: MotionEstimate, elapsed_s: F64) -> MotionEstimate:
    """Mix the modes and predict over N intervals [s]."""
    weight, modes = imm.mixing_weights(motion.modes, _transitions(elapsed_s))
    axes = [imm.moments(weight, motion.states[:, :, a], motion.covariances) for a in range(2)]
    decay, reach = velocity_decay(elapsed_s[:, None])  # Nx3
    F = np.zeros((*decay.shape, 2, 2))
    F[..., 0, 0], F[..., 0, 1], F[..., 1, 1] = 1.0, reach, decay
    covariances = F @ ((axes[0][1] + axes[1][1]) / 2) @ F.swapaxes(-1, -2)
    t = elapsed_s[:, None]
    Q = np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]]) * ACCELERATIONS**2
    states = np.stack([mean for mean, _ in axes], axis=2) @ F.swapaxes(-1, -2)
    return MotionEstimate(states, covariances + np.moveaxis(Q, (0, 1), (2, 3)), modes)


def update_motion(motion: MotionEstimate, part: int, values: F64, sigma: F64) -> MotionEstimate:
    """Update with measured positions (part 0) or velocities (part 1).

    Args:
        motion: Predicted motion.
        part: POSITION or VELOCITY.
        values: Nx2 [m or m/s].
        sigma: N standard deviations, per axis.
    """
    y, cross = values[:, None] - motion.states[..., part], motion.covariances[..., part, :]
    S = cross[..., part] + sigma[:, None] ** 2
    K = cross / S[..., None]
    return MotionEstimate(
        motion.states + y[..., None] * K[:, :, None],
        motion.covariances - K[..., :, None] * cross[..., None, :],
        imm.weighed(motion.modes, (y**2).sum(axis=-1) / S, 2 * np.log(S)),
    )


def velocity_decay(elapsed_s: F64) -> tuple[F64, F64]:
    """Return the remaining share of velocity, and displacement per velocity [s], by mode."""
    decay = np.exp(-elapsed_s / DECAYS_S)
    return decay, DECAYS_S * (1 - decay)


def _transitions(elapsed_s: F64) -> F64:
    """Return the probabilities (Nx3x3) of mode changes over N intervals [s]."""
    leave = CHANGE_RATES_HZ.sum(axis=1)
    stay = np.exp(-leave * elapsed_s[:, None])[:, :, None]  # Nx3x1
    change = (1 - stay) * CHANGE_RATES_HZ / np.maximum(leave, 1e-12)[:, None]
    result: F64 = change + stay * np.eye(len(leave))
    return result
