"""How boxes move from one frame to the next (method book section 8.1).

A state is [x, y, x', y', w, h, w', h']: centre and size in pixels, and their change in pixels a
frame. With a state of 4 the size stays, which is the same model without noise of the size.
"""

import numpy as np

from people4d.messages import F64
from services.gait.colour.config import ColourLayerConfig

STATES = 8
FIRST = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]], np.float64)
SECOND = np.array([[0.5, 0, 0.5, 0], [0, 0.5, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]], np.float64)


class MotionModel:
    """Moves particles and adds noise.

    Args:
        config: Order, sampling and noise.

    Source: method book section 8.1 [G 3.2, 3.11, 3.30 to 3.32].
    """

    def __init__(self, config: ColourLayerConfig) -> None:
        self._config = config
        matrix = np.zeros((STATES, STATES))
        matrix[:4, :4] = matrix[4:, 4:] = FIRST if config.order == 1 else SECOND
        self._transposed = matrix.T
        self._tau = np.array(config.tau)
        if config.state == 4:
            self._tau[4:] = 0.0

    def __call__(self, states: F64, before: F64, generator: np.random.Generator) -> F64:
        """Return the particles of the next frame.

        Args:
            states: PxNx8.
            before: PxNx8, the same particles one frame earlier; used by the second order.
            generator: Of random numbers.
        """
        noise = self._tau * generator.standard_normal(states.shape)
        if self._config.sampling == "hierarchical":
            noise[..., :2] = self._along(noise[..., :2], states)
            if self._config.state == STATES:
                noise[..., 6:] += self._growth(states, generator)[..., None]
        if self._config.order == 1:
            moved = states @ self._transposed
        else:
            moved = states + (states - before) @ self._transposed
        if self._config.state == 4:
            moved[..., 4:] = states[..., 4:]
        moved += noise
        np.maximum(moved[..., 4:6], self._config.box_min_px, out=moved[..., 4:6])
        return np.asarray(moved)

    def _along(self, noise: F64, states: F64) -> F64:
        """Turn and stretch the noise of the first particles along their motion."""
        config = self._config
        velocities = states[..., 2:4]
        speeds = np.linalg.norm(velocities, axis=-1, keepdims=True)
        along = velocities / np.maximum(speeds, 1e-9)
        across = along[..., ::-1] * (-1.0, 1.0)
        placed = (
            noise[..., :1] * config.along_stretch * along
            + noise[..., 1:] / config.along_stretch * across
        )
        chosen = np.arange(noise.shape[-2])[:, None] < config.along_share * noise.shape[-2]
        return np.where(chosen & (speeds >= config.speed_min_px), placed, noise)

    def _growth(self, states: F64, generator: np.random.Generator) -> F64:
        """Return what hierarchical sampling adds to w' and h'.

        The faster the sideways motion, the less the box may grow or shrink: of a / x' it is the
        spread that counts, since to the left nobody shrinks. The faster the motion down, towards
        the camera, the more it grows.
        """
        config = self._config
        a, b = generator.normal(1.0, 1.0, (2, *states.shape[:-1]))
        sideways = np.maximum(np.abs(states[..., 2]), config.speed_min_px)
        spread = config.growth_sideways_px2 * (a - 1.0) / sideways
        return np.asarray(spread + config.growth_upright * b * states[..., 3])
