"""Motion and resampling of the particles of many people at once.

A box state is [x, y, x', y', w, h, w', h']: centre and size in pixels, and their change in pixels a
frame. With 4 state variables the size is constant.

Source: docs/method.md, section 8.1 [Gordon 1993].
"""

import numpy as np
import numpy.typing as npt

from people4d.messages import F64
from services.gait.config import ColourLayerConfig

I64 = npt.NDArray[np.int64]

STATES = 8
FIRST = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]], np.float64)
SECOND = np.array([[0.5, 0, 0.5, 0], [0, 0.5, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]], np.float64)
BOX_MIN_PX = 4.0  # Minimum side of a box [px]
# Hierarchical sampling. a and b have mean and variance 1, times these factors; published: 1 for
# both, which doubles a box within a second
GROWTH_SIDEWAYS_PX2 = 0.02  # Factor of a / |x'| [px^2 a frame^3]
GROWTH_UPRIGHT = 0.005  # Factor of b y' [1 a frame]
SPEED_MIN_PX = 1.0  # Minimum |x'|, and minimum speed with a direction [px a frame]
ALONG_SHARE = 0.5  # Share of the particles that are sampled along the motion
ALONG_STRETCH = 1.4  # Factor of their noise along the motion, and its inverse across


class BoxMotionModel:
    """Moves particles and adds noise.

    Source: docs/method.md, section 8.1 (G 3.2, 3.11, 3.30 to 3.32).
    """

    def __init__(self, config: ColourLayerConfig) -> None:
        self._config = config
        matrix = np.zeros((STATES, STATES))
        matrix[:4, :4] = matrix[4:, 4:] = FIRST if config.order == 1 else SECOND
        self._transposed = matrix.T
        self._tau = np.array(config.tau)
        if config.state == 4:
            self._tau[4:] = 0.0

    def __call__(self, states: F64, previous: F64, generator: np.random.Generator) -> F64:
        """Return the particles (PxNx8) of the next frame.

        Second order motion also uses the particles of the previous frame.
        """
        noise = self._tau * generator.standard_normal(states.shape)
        if self._config.sampling == "hierarchical":
            noise[..., :2] = self._stretched(noise[..., :2], states)
            if self._config.state == STATES:
                noise[..., 6:] += self._growth(states, generator)[..., None]
        if self._config.order == 1:
            moved = states @ self._transposed
        else:
            moved = states + (states - previous) @ self._transposed
        if self._config.state == 4:
            moved[..., 4:] = states[..., 4:]
        moved += noise
        np.maximum(moved[..., 4:6], BOX_MIN_PX, out=moved[..., 4:6])
        return np.asarray(moved)

    def _stretched(self, noise: F64, states: F64) -> F64:
        """Rotate and stretch the noise of the first particles along their motion."""
        velocities = states[..., 2:4]
        speeds = np.linalg.norm(velocities, axis=-1, keepdims=True)
        along = velocities / np.maximum(speeds, 1e-9)
        across = along[..., ::-1] * (-1.0, 1.0)
        stretched = noise[..., :1] * ALONG_STRETCH * along + noise[..., 1:] / ALONG_STRETCH * across
        chosen = np.arange(noise.shape[-2])[:, None] < ALONG_SHARE * noise.shape[-2]
        return np.where(chosen & (speeds >= SPEED_MIN_PX), stretched, noise)

    def _growth(self, states: F64, generator: np.random.Generator) -> F64:
        """Return the addition of hierarchical sampling to w' and h'.

        The faster the sideways motion, the less the box may grow or shrink. Only the spread of
        a / x' is used: its mean would shrink every box that moves to the left. The faster the
        motion down, towards the camera, the more the box grows.
        """
        a, b = generator.normal(1.0, 1.0, (2, *states.shape[:-1]))
        sideways = np.maximum(np.abs(states[..., 2]), SPEED_MIN_PX)
        spread = GROWTH_SIDEWAYS_PX2 * (a - 1.0) / sideways
        return np.asarray(spread + GROWTH_UPRIGHT * b * states[..., 3])


def resample_systematic(weights: F64, generator: np.random.Generator) -> I64:
    """Draw at N equally spaced positions, with one random number for each person.

    Returns the index (PxN) of the particle that each new one is a copy of. A particle of weight w
    (PxN, each row sums to 1) is copied N w times, rounded up or down.
    """
    people, count = weights.shape
    positions = (np.arange(count) + generator.random((people, 1))) / count
    sums = np.cumsum(weights, axis=1)
    sums[:, -1] = 1.0  # exact despite rounding
    # One search for all people: the sums of each person are above the sums of the previous one.
    above = np.arange(people)[:, None]
    found = np.searchsorted((sums + above).ravel(), (positions + above).ravel(), side="right")
    return np.asarray(np.clip(found.reshape(people, count) - above * count, 0, count - 1), np.int64)
