"""People who stand and people who walk: two motion models that interact.

Whoever stands has no velocity, and every error of their measured position would give them one. So
two filters run side by side for everybody: one for whom a person stands, one for whom they walk
(method book section 3). Each is as likely as it foretells what is measured, and people change from
one to the other at a rate. Told is the mean of both.
Source: Blom and Bar-Shalom, The interacting multiple model algorithm, 1988.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from services.tracker.motion import kalman
from services.tracker.motion.motion import PointMotion
from services.tracker.motion.standing_config import StandingConfig
from services.tracker.strongsort3d.occlusion import BOOL, Fading

STANDS, WALKS = 0, 1
LEAST = 1e-6  # share that each model keeps


@dataclass(frozen=True, slots=True)
class Pace:
    """One person as both models have them."""

    x: F64  # 2x6 states: standing, walking
    P: F64  # 2x6x6, their covariances
    share: F64  # 2, how likely each is

    def fits(self, n: int) -> bool:
        """Tell whether these are states of n numbers."""
        shapes = self.x.shape, self.P.shape, self.share.shape
        return shapes == ((2, n), (2, n, n), (2,)) and bool(np.all(self.share > 0))


class StandOrWalk:
    """The filters of many people, N at once.

    Args:
        motion: How people walk.
        config: How people stand, and how often they begin and stop to walk.
        fading: What becomes of the way people walk whom nobody sees; None: nothing.
    """

    def __init__(
        self, motion: PointMotion, config: StandingConfig, fading: Fading | None = None
    ) -> None:
        self._motion = motion
        self._config = config
        self._fading = fading

    def start(self, x: F64, P: F64) -> Pace:
        """Begin with one state (6) and covariance (6x6): nobody knows whether they stand."""
        return Pace(np.array([x, x]), np.array([P, P]), np.array([0.5, 0.5]))

    def predict(self, paces: Sequence[Pace], unseen: BOOL, dt_s: float) -> list[Pace]:
        """Let people (N, each unseen or not) change their pace and move on for dt_s seconds."""
        x, P, share = _stack(paces)
        config = self._config
        stops, starts = (-math.expm1(-dt_s / s) for s in (config.walks_s, config.stands_s))
        change = np.array([[1 - starts, starts], [stops, 1 - stops]])
        x, P, share = mix(x, P, share, change)
        walks_x, walks_P = x[:, WALKS], P[:, WALKS]
        if self._fading:
            walks_x, walks_P = self._fading(walks_x, walks_P, unseen, dt_s)
        walks_x, walks_P = self._motion.predict(walks_x, walks_P, dt_s)
        stands_x, stands_P = self._stand(x[:, STANDS], P[:, STANDS], dt_s)
        x, P = np.stack([stands_x, walks_x], 1), np.stack([stands_P, walks_P], 1)
        return _split(x, P, share)

    def update(self, paces: Sequence[Pace], z: F64, R: F64) -> list[Pace]:
        """Correct with one measurement (3) each, and weigh the models by it."""
        x, P, share = _stack(paces)
        z, R, H = z[:, None], R[:, None], self._motion.H
        logs = log_likelihood(*kalman.innovation(x, P, z, H, R / self._config.evidence))
        x, P = kalman.update(x, P, z, H, R)
        logs -= logs.max(axis=1, keepdims=True)
        share = share * np.exp(logs)
        share = np.maximum(share / share.sum(axis=1, keepdims=True), LEAST)
        return _split(x, P, share / share.sum(axis=1, keepdims=True))

    def told(self, pace: Pace) -> tuple[F64, F64]:
        """Return the mean state (6) and covariance (6x6) of both models."""
        P = pace.P.copy()
        P[STANDS, 3:] = P[STANDS, :, 3:] = 0.0
        P[STANDS, [3, 4, 5], [3, 4, 5]] = self._config.sway_mps**2
        x = pace.share @ pace.x
        off = pace.x - x
        return x, np.einsum("j,jab->ab", pace.share, P + off[:, :, None] * off[:, None])

    def _stand(self, x: F64, P: F64, dt_s: float) -> tuple[F64, F64]:
        """Stay: with a velocity of 0, and of any walk's variance for when they begin to walk."""
        x, P = x.copy(), P.copy()
        x[:, 3:] = 0.0
        P[:, 3:] = P[:, :, 3:] = 0.0
        places, level = [0, 1, 2], [3, 4]
        P[:, places, places] += self._config.sway_mps**2 * dt_s**2 + self._config.drift_m2ps * dt_s
        P[:, level, level] = self._config.walk_sigma_mps**2
        P[:, 5, 5] = self._config.sway_mps**2
        return x, P


def mix(x: F64, P: F64, share: F64, change: F64) -> tuple[F64, F64, F64]:
    """Return what each model starts from: whoever may have changed over to it, and who stayed.

    Args:
        x: Nx2x6 states.
        P: Nx2x6x6 covariances.
        share: Nx2, how likely each model is.
        change: 2x2, probability of a change from row to column.

    Returns:
        States, covariances and shares, as they are before the step.
    """
    joint = share[:, :, None] * change  # N, from, to
    after = joint.sum(axis=1)
    weight = joint / after[:, None]
    mean = np.einsum("nij,nia->nja", weight, x)
    off = x[:, :, None] - mean[:, None]  # N, from, to, 6
    spread = P[:, :, None] + off[..., :, None] * off[..., None, :]
    return mean, np.einsum("nij,nijab->njab", weight, spread), after


def log_likelihood(y: F64, S: F64) -> F64:
    """Return the logarithm of the normal density, less a constant.

    Args:
        y: ...xm, innovations.
        S: ...xmxm, their covariances.
    """
    d2 = np.sum(y * np.linalg.solve(S, y[..., None])[..., 0], axis=-1)
    result: F64 = -0.5 * (d2 + np.linalg.slogdet(S)[1])
    return result


def _stack(paces: Sequence[Pace]) -> tuple[F64, F64, F64]:
    return (
        np.array([p.x for p in paces]),
        np.array([p.P for p in paces]),
        np.array([p.share for p in paces]),
    )


def _split(x: F64, P: F64, share: F64) -> list[Pace]:
    return [Pace(*one) for one in zip(x, P, share, strict=True)]
