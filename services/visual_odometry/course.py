"""How a base goes on: its place since a keyframe and its twist, each with what is known of it."""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from common.geometry.transforms import invert, transform_from
from people4d.messages import F64
from services.visual_odometry.config import VisualOdometryConfig
from services.visual_odometry.fit import INDICES, Fit, Prior


@dataclass(frozen=True)
class Course:
    """Steady speed and turn, disturbed by white acceleration (method book section 3).

    Args:
        stamp_ns: Time that it holds at.
        keyframe_from_base: 4x4, the base since the keyframe.
        twist: 6, vx, vy, vz, wx, wy, wz, frame: the base.
        P: 2Kx2K, covariance of the free entries of the twist by which the base may be elsewhere,
            then of the twist itself.
    """

    stamp_ns: int
    keyframe_from_base: F64
    twist: F64
    P: F64


def begin(stamp_ns: int, free: INDICES, config: VisualOdometryConfig) -> Course:
    """Return the course of a base in a keyframe, of which nothing else is known."""
    unknown = _sigmas(config.speed_sigma_mps, config.turn_sigma_radps, config)[free]
    P = np.diag(np.concatenate([np.zeros(len(free)), unknown**2]))
    return Course(stamp_ns, np.eye(4), np.zeros(6), P)


def predict(course: Course, stamp_ns: int, free: INDICES, config: VisualOdometryConfig) -> Course:
    """Return the course at a later time; after some time a base is thought to have stopped."""
    dt_s = (stamp_ns - course.stamp_ns) / 1e9
    count = len(free)
    way = move(course.twist * min(dt_s, config.predict_s))
    F = np.eye(2 * count)
    F[:count, :count] = _seen_from(invert(way))[np.ix_(free, free)]
    F[:count, count:] = min(dt_s, config.predict_s) * np.eye(count)
    sigma = _sigmas(config.sigma_acceleration_mps2, config.sigma_turn_radps2, config)[free]
    G = np.concatenate([np.diag(sigma * dt_s**2 / 2), np.diag(sigma * dt_s)])
    return replace(
        course,
        stamp_ns=stamp_ns,
        keyframe_from_base=course.keyframe_from_base @ way,
        twist=course.twist if dt_s <= config.predict_s else np.zeros(6),
        P=F @ course.P @ F.T + G @ G.T,
    )


def prior_of(course: Course, free: INDICES) -> Prior:
    """Return what is known of the motion since the keyframe."""
    count = len(free)
    # A base that was just seen is not known better than that.
    return Prior(course.keyframe_from_base, course.P[:count, :count] + 1e-10 * np.eye(count))


def correct(course: Course, fit: Fit, free: INDICES) -> Course:
    """Return the course after the motion since the keyframe was found; the fit knew the prior."""
    count = len(free)
    known = prior_of(course, free).covariance
    gain = course.P[count:, :count] @ np.linalg.inv(known)
    off = twist_of(invert(course.keyframe_from_base) @ fit.before_from_now)[free]
    twist = course.twist.copy()
    twist[free] += gain @ off
    P = np.empty_like(course.P)
    P[:count, :count] = fit.covariance
    P[count:, :count] = gain @ fit.covariance
    P[:count, count:] = P[count:, :count].T
    P[count:, count:] = course.P[count:, count:] + gain @ (fit.covariance - known) @ gain.T
    return Course(course.stamp_ns, fit.before_from_now, twist, (P + P.T) / 2)


def since(course: Course, keyframe_from_base: F64, covariance: F64) -> Course:
    """Return the course since another keyframe; covariance (KxK) of the base's place since then."""
    count = len(covariance)
    P = np.zeros_like(course.P)
    P[:count, :count], P[count:, count:] = covariance, course.P[count:, count:]
    return replace(course, keyframe_from_base=keyframe_from_base, P=P)


def move(twist: F64) -> F64:
    """Return the 4x4 motion of a twist (6) that lasts for 1 s: along an arc."""
    turn = twist[3:]
    angle = float(np.linalg.norm(turn))
    rotation = Rotation.from_rotvec(turn).as_matrix()
    # Midpoint of the turn: exact for the direction, and for the length to angle^2 / 24.
    half = Rotation.from_rotvec(turn / 2).as_matrix()
    chord = math.sin(angle / 2) / (angle / 2) if angle > 1e-9 else 1.0
    return transform_from(chord * (half @ twist[:3]), rotation)


def twist_of(matrix: F64) -> F64:
    """Return the small twist (6) of a 4x4 motion."""
    return np.concatenate([matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]).as_rotvec()])


def _sigmas(way: float, turn: float, config: VisualOdometryConfig) -> F64:
    """Return the standard deviations of a twist (6): a base on wheels hardly moves sideways."""
    sideways = config.sideways if config.planar else 1.0
    return np.array([way, sideways * way, way, turn, turn, turn])


def _seen_from(target_from_source: F64) -> F64:
    """Return the 6x6 that makes a twist of one frame that of another fixed to it (the adjoint)."""
    turn, (x, y, z) = target_from_source[:3, :3], target_from_source[:3, 3]
    moved = np.zeros((6, 6))
    moved[:3, :3] = moved[3:, 3:] = turn
    moved[:3, 3:] = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ turn
    return moved
