"""Who hides whom, and how people move while nobody sees them."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from common.geometry import apply, invert
from common.messages import F64
from services.tracker.identity_config import OcclusionConfig

NEAR_M = 0.3  # [m] people nearer to the camera's plane than this are not in its view
BOOL = npt.NDArray[np.bool_]


def hidden(positions_m: F64, seen: BOOL, map_from_camera: F64, config: OcclusionConfig) -> BOOL:
    """Tell whom somebody seen stands before.

    Every person is an upright strip, as wide as a person, of the image at their distance. Whoever
    is not seen and has enough of the strip covered by people who are seen, and not farther away, is
    hidden.

    Args:
        positions_m: Nx3, in the map.
        seen: N, who was detected in this frame.
        map_from_camera: 4x4, from the optical frame.
        config: Width of a strip and the share to be covered.

    Returns:
        N, False for those who are seen.
    """
    points = apply(invert(map_from_camera), positions_m)
    depth = points[:, 2]
    before = depth > NEAR_M
    scale = 1.0 / np.where(before, depth, 1.0)
    centre, half = points[:, 0] * scale, config.half_width_m * scale
    left, right = centre - half, centre + half
    common = np.minimum(right[:, None], right) - np.maximum(left[:, None], left)
    share = common / (right - left)[:, None]
    hides = seen & before & (depth[None] < depth[:, None] + config.nearer_slack_m)
    covered = np.where(hides, share, 0.0).max(axis=1, initial=0.0)
    result: BOOL = ~seen & before & (covered >= config.covered_min)
    return result


class Fading:
    """The velocity of people who are not seen: it dies out, and its uncertainty comes back.

    An Ornstein-Uhlenbeck process: over dt the velocity shrinks by k = exp(-dt / tau), and
    (1 - k^2) sigma^2 is added to its variance, so that the position's uncertainty keeps growing
    while the predicted position comes to rest.

    Args:
        config: tau and sigma.
        velocity: Where the velocities stand in the state.
    """

    def __init__(self, config: OcclusionConfig, velocity: Sequence[int]) -> None:
        self._config = config
        self._velocity = np.array(velocity)

    def __call__(self, x: F64, P: F64, unseen: BOOL, dt_s: float) -> tuple[F64, F64]:
        """Return states (Nxn) and covariances (Nxnxn) with the velocities of the unseen faded."""
        if not unseen.any():
            return x, P
        kept = math.exp(-dt_s / self._config.velocity_decay_s)
        factor = np.ones_like(x)
        factor[np.ix_(unseen.nonzero()[0], self._velocity)] = kept
        variance = np.zeros_like(x)
        level = self._velocity[:2]  # nobody who walks moves up or down
        variance[np.ix_(unseen.nonzero()[0], level)] = (
            1 - kept**2
        ) * self._config.walk_sigma_mps**2
        P = factor[:, :, None] * P * factor[:, None]
        return factor * x, P + variance[:, :, None] * np.eye(x.shape[1])
