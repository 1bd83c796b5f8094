"""Who hides whom, and how people move while nobody sees them."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import apply, invert
from people4d.messages import F64
from services.tracker.identity.config import OcclusionConfig

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
    strips, depth = columns(positions_m, map_from_camera, config.half_width_m)
    before = depth > NEAR_M
    share = shares(strips, strips)
    hides = seen & before & (depth[None] < depth[:, None] + config.nearer_slack_m)
    covered = np.where(hides, share, 0.0).max(axis=1, initial=0.0)
    result: BOOL = ~seen & before & (covered >= config.covered_min)
    return result


def emergence_m(found_m: F64, map_from_camera: F64, config: OcclusionConfig) -> F64:
    """Return how far each person found is from where they could have been hidden.

    Args:
        found_m: Nx3, in the map.
        map_from_camera: 4x4, from the optical frame.
        config: Width of a person.

    Returns:
        N, metres between a person and the strip behind somebody found who is not farther away;
        infinity if there is nobody.
    """
    strips, depth = columns(found_m, map_from_camera, config.half_width_m)
    gap = np.maximum(
        strips[:, None, 0] - strips[None, :, 1], strips[None, :, 0] - strips[:, None, 1]
    )
    nearer = depth[None] < depth[:, None] + config.nearer_slack_m
    np.fill_diagonal(nearer, False)
    gap_m = np.where(nearer, np.maximum(gap, 0.0) * depth[:, None], np.inf)
    return np.asarray(gap_m.min(axis=1, initial=np.inf))


def columns(positions_m: F64, map_from_camera: F64, half_width_m: float) -> tuple[F64, F64]:
    """Return the strips of the image (Nx2: left, right, at focal length 1) where people stand.

    Args:
        positions_m: Nx3, in the map.
        map_from_camera: 4x4, from the optical frame.
        half_width_m: Half of a person's width.

    Returns:
        The strips, and the depth (N) of each person in metres.
    """
    points = apply(invert(map_from_camera), positions_m)
    depth = points[:, 2]
    scale = 1.0 / np.where(depth > NEAR_M, depth, 1.0)
    centre, half = points[:, 0] * scale, half_width_m * scale
    return np.stack([centre - half, centre + half], axis=-1), depth


def shares(strips: F64, others: F64) -> F64:
    """Return the share (NxM, below 0 if apart) of each strip (Nx2) that each other one covers."""
    low = np.maximum(strips[:, None, 0], others[None, :, 0])
    high = np.minimum(strips[:, None, 1], others[None, :, 1])
    share: F64 = (high - low) / (strips[:, 1] - strips[:, 0])[:, None]
    return share


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
