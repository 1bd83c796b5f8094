"""Motion of a base since a keyframe: pose and twist with their covariance (constant velocity)."""

from dataclasses import dataclass, replace

import numpy as np

from common.geometry.transforms import invert
from people4d.messages import F64
from services.visual_odometry.config import VisualOdometryConfig
from services.visual_odometry.fit import MotionFit, MotionPrior
from services.visual_odometry.reprojection import Indices
from services.visual_odometry.twist import adjoint, arc_motion, twist_of


@dataclass(frozen=True)
class MotionState:
    """Constant twist, disturbed by white acceleration (docs/method.md section 18)."""

    stamp_ns: int
    keyframe_from_base: F64  # 4x4, the base since the keyframe
    twist: F64  # 6, vx, vy, vz, wx, wy, wz, frame: the base
    P: F64  # 2Kx2K, of the free entries of the twist of the pose's error, then of the twist itself


def initial_state(stamp_ns: int, free: Indices, config: VisualOdometryConfig) -> MotionState:
    """Return the state of a base in a keyframe, of unknown twist."""
    unknown = _sigmas(config.speed_sigma_mps, config.turn_sigma_radps, config)[free]
    P = np.diag(np.concatenate([np.zeros(len(free)), unknown**2]))
    return MotionState(stamp_ns, np.eye(4), np.zeros(6), P)


def predict(
    state: MotionState, stamp_ns: int, free: Indices, config: VisualOdometryConfig
) -> MotionState:
    """Return the state at a later time; after `predict_s` the base is assumed to have stopped."""
    dt_s = (stamp_ns - state.stamp_ns) / 1e9
    count = len(free)
    motion = arc_motion(state.twist * min(dt_s, config.predict_s))
    F = np.eye(2 * count)
    F[:count, :count] = adjoint(invert(motion))[np.ix_(free, free)]
    F[:count, count:] = min(dt_s, config.predict_s) * np.eye(count)
    sigma = _sigmas(config.sigma_acceleration_mps2, config.sigma_turn_radps2, config)[free]
    G = np.concatenate([np.diag(sigma * dt_s**2 / 2), np.diag(sigma * dt_s)])
    return replace(
        state,
        stamp_ns=stamp_ns,
        keyframe_from_base=state.keyframe_from_base @ motion,
        twist=state.twist if dt_s <= config.predict_s else np.zeros(6),
        P=F @ state.P @ F.T + G @ G.T,
    )


def prior_of(state: MotionState, free: Indices) -> MotionPrior:
    """Return the prediction of the motion since the keyframe."""
    count = len(free)
    # The covariance is not exactly zero just after a keyframe.
    return MotionPrior(state.keyframe_from_base, state.P[:count, :count] + 1e-10 * np.eye(count))


def correct(state: MotionState, fit: MotionFit, free: Indices) -> MotionState:
    """Return the state after a fit of the motion since the keyframe, which includes the prior."""
    count = len(free)
    prior_m2 = prior_of(state, free).covariance
    gain = state.P[count:, :count] @ np.linalg.inv(prior_m2)
    off = twist_of(invert(state.keyframe_from_base) @ fit.before_from_now)[free]
    twist = state.twist.copy()
    twist[free] += gain @ off
    P = np.empty_like(state.P)
    P[:count, :count] = fit.covariance
    P[count:, :count] = gain @ fit.covariance
    P[:count, count:] = P[count:, :count].T
    P[count:, count:] = state.P[count:, count:] + gain @ (fit.covariance - prior_m2) @ gain.T
    return MotionState(state.stamp_ns, fit.before_from_now, twist, (P + P.T) / 2)


def change_keyframe(state: MotionState, keyframe_from_base: F64, covariance: F64) -> MotionState:
    """Return the state since another keyframe; covariance (KxK) of the base's pose since then."""
    count = len(covariance)
    P = np.zeros_like(state.P)
    P[:count, :count], P[count:, count:] = covariance, state.P[count:, count:]
    return replace(state, keyframe_from_base=keyframe_from_base, P=P)


def _sigmas(linear: float, angular: float, config: VisualOdometryConfig) -> F64:
    """Return the standard deviations of a twist (6): a base on wheels hardly moves sideways."""
    sideways = config.sideways if config.planar else 1.0
    return np.array([linear, sideways * linear, linear, angular, angular, angular])
