"""Motion of a base since a keyframe: pose and twist with covariance (constant velocity)."""

from dataclasses import dataclass, replace

import numpy as np

from common.geometry.transforms import invert
from people4d.messages import F64
from services.visual_odometry.config import VisualOdometryConfig
from services.visual_odometry.fit import MotionFit, MotionPrior
from services.visual_odometry.reprojection import Indices
from services.visual_odometry.twist import adjoint, arc_motion, twist_of

PREDICT_S = 0.5  # maximum duration of extrapolation [s]
# Standard deviations of the initial twist [m/s, rad/s], and of unobserved acceleration [m/s^2,
# rad/s^2]
SPEED_SIGMA_MPS, TURN_SIGMA_RADPS = 0.5, 1.0
SIGMA_ACCELERATION_MPS2, SIGMA_TURN_RADPS2 = 1.0, 2.0


@dataclass(frozen=True)
class MotionState:
    """Constant twist, disturbed by white acceleration (docs/method.md section 18)."""

    stamp_ns: int
    keyframe_from_base: F64  # 4x4
    twist: F64  # 6, vx, vy, vz, wx, wy, wz, frame: the base
    P: F64  # 2Kx2K covariance: free entries of the pose error as a twist, then of the twist


def initial_state(stamp_ns: int, free: Indices, config: VisualOdometryConfig) -> MotionState:
    """Return the state of a base at a keyframe, with unknown twist."""
    unknown = _sigmas(SPEED_SIGMA_MPS, TURN_SIGMA_RADPS, config)[free]
    P = np.diag(np.concatenate([np.zeros(len(free)), unknown**2]))
    return MotionState(stamp_ns, np.eye(4), np.zeros(6), P)


def predict_state(
    state: MotionState, stamp_ns: int, free: Indices, config: VisualOdometryConfig
) -> MotionState:
    """Predict the state at a later time; after `PREDICT_S` the base is assumed to stand."""
    dt_s = (stamp_ns - state.stamp_ns) / 1e9
    count = len(free)
    motion = arc_motion(state.twist * min(dt_s, PREDICT_S))
    F = np.eye(2 * count)
    F[:count, :count] = adjoint(invert(motion))[np.ix_(free, free)]
    F[:count, count:] = min(dt_s, PREDICT_S) * np.eye(count)
    sigma = _sigmas(SIGMA_ACCELERATION_MPS2, SIGMA_TURN_RADPS2, config)[free]
    G = np.concatenate([np.diag(sigma * dt_s**2 / 2), np.diag(sigma * dt_s)])
    return replace(
        state,
        stamp_ns=stamp_ns,
        keyframe_from_base=state.keyframe_from_base @ motion,
        twist=state.twist if dt_s <= PREDICT_S else np.zeros(6),
        P=F @ state.P @ F.T + G @ G.T,
    )


def prior_of(state: MotionState, free: Indices) -> MotionPrior:
    """Return the prediction of the motion since the keyframe."""
    count = len(free)
    # At a keyframe the covariance is zero; 1e-10 keeps it invertible.
    return MotionPrior(state.keyframe_from_base, state.P[:count, :count] + 1e-10 * np.eye(count))


def correct_state(state: MotionState, fit: MotionFit, free: Indices) -> MotionState:
    """Correct the state by a fit of the motion since the keyframe, which includes the prior."""
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
    """Return the state relative to another keyframe; covariance (KxK) of the relative pose."""
    count = len(covariance)
    P = np.zeros_like(state.P)
    P[:count, :count], P[count:, count:] = covariance, state.P[count:, count:]
    return replace(state, keyframe_from_base=keyframe_from_base, P=P)


def _sigmas(linear: float, angular: float, config: VisualOdometryConfig) -> F64:
    """Return the standard deviations of a twist (6), reduced sideways for a base on wheels."""
    sideways = config.sideways if config.planar else 1.0
    return np.array([linear, sideways * linear, linear, angular, angular, angular])
