"""Yaw by the joint likelihood of all cues of one frame (docs/method.md section 11).

At every angle a body has a known appearance: the distance of the shoulders across the line of
sight, and the nose between the ears. The yaw is the angle with the highest likelihood of both cues
and, by the network, of the image. Angles count from the line of sight: 0 is facing away, pi facing
the camera, + is to the left. An uninformative likelihood is flat, so no selection is needed.
"""

import math

import numpy as np

from common.geometry.transforms import wrap, wrap_each
from people4d.messages import F32, F64
from services.detector.orientation.angle import YawEstimate
from services.detector.orientation.observation import YawObservations, observe_bodies
from services.detector.position.surface import DepthImage

# Distance of the shoulders in the annotations of networks, 0.19 of stature, and the distance in
# profile of the nearer shoulder ahead of the farther [m], fitted to renders of the simulated room
WIDTH_M, AHEAD_M = 0.32, 0.01
SIGMA_ACROSS_M = 0.04  # standard deviation of a distance across the line of sight [m]
SIGMA_WIDTH = 0.07  # standard deviation of people's widths, relative
JOINT_PX = 2.1  # standard deviation of a joint in the image [px]
# Distance of the nose ahead of the ears, and between the ears, as annotated [m]
NOSE_M, EARS_M = 0.08, 0.125
SIGMA_FACE = 0.3  # standard deviation of the nose, over NOSE_M
SIGMA_HEAD_RAD = 0.3  # standard deviation of the head's yaw on the chest [rad]
SIDE_CONFIDENCE = 0.6  # mean confidence of a side's keypoints below which sigma grows
SWAPPED, SWAPPED_MAX = 0.03, 0.5  # probability that left and right are confused, and its maximum
STEP_DEG = 3  # step of the angles [deg]
ANGLES: F64 = np.radians(np.arange(-180, 180, STEP_DEG))
SINE, COSINE = np.sin(ANGLES), np.cos(ANGLES)
OPPOSITE = np.roll(np.arange(len(ANGLES)), len(ANGLES) // 2)  # index of the opposite angle
OFFSETS: F64 = wrap_each(ANGLES - ANGLES[:, None])  # [rad] angles from each angle
NEAR = np.abs(OFFSETS) <= math.radians(60)  # angles for mean and variance, by best angle
FAR_MAX = 0.1  # maximum probability of the other angles
# Outlier probabilities (joints of another person, guessed joints) of shoulders and head, and the
# range of outliers [m, rad]
OUTLIERS: F64 = np.array([0.05, 0.1])[:, None, None]
SPANS: F64 = np.array([1.0, 2 * math.pi])[:, None, None]
# Expected distance from the left shoulder to the right one, across the line of sight, to the right,
# by angle [m], and the variance between people [m^2]
EXPECTED_M: F64 = WIDTH_M * COSINE - AHEAD_M * SINE**2
WIDTHS_M2: F64 = (SIGMA_WIDTH * WIDTH_M * COSINE) ** 2
SIGMA_MAX_RAD = math.pi / 2  # maximum standard deviation of an estimated angle [rad]


def joint_yaws(
    keypoints: F32,
    layers_m: F64,
    image: DepthImage,
    by_image: F64 | None = None,
) -> list[YawEstimate | None]:
    """Estimate the yaws of N people from all cues at once.

    `by_image` (NxA) is the log likelihood of each of `ANGLES`, from `OrientationNetwork`. See
    `observe_bodies` for the other arguments.
    """
    observations = observe_bodies(keypoints, layers_m, image)
    log_p = log_likelihood(observations, image.info.fx)
    if by_image is not None:
        log_p += by_image
    best_rad, sigma_rad = best_angles(log_p)
    sigma_rad *= sigma_factors(observations)
    yaws_rad = best_rad + observations.ray_rad
    return [
        YawEstimate(wrap(yaw), sigma) if sigma < SIGMA_MAX_RAD else None
        for yaw, sigma in zip(yaws_rad.tolist(), sigma_rad.tolist(), strict=True)
    ]


def log_likelihood(observations: YawObservations, fx: float) -> F64:
    """Return the logarithm of the likelihood of each of `ANGLES`, NxA; fx in pixels."""
    density = _densities(observations, fx).prod(axis=0)
    # Low confidence of the joints of a side makes confusion of the sides more likely.
    swapped = np.minimum(SWAPPED * sigma_factors(observations) ** 2, SWAPPED_MAX)[:, None]
    log_p: F64 = np.log((1 - swapped) * density + swapped * density[:, OPPOSITE])
    return log_p


def _densities(observations: YawObservations, fx: float) -> F64:
    """Return the densities of shoulders and head, 2xNxA.

    A density is normal with a fraction of uniform outliers; 1 if the cue is unknown.
    """
    errors = np.empty((2, len(observations.z_m), len(ANGLES)))
    errors[0] = observations.shoulders_m[:, None] - EXPECTED_M
    # Variances of joints, pixels and widths of people
    joints_m2 = SIGMA_ACROSS_M**2 + 2 * (JOINT_PX * observations.z_m / fx) ** 2
    variances = np.empty_like(errors)
    variances[0] = joints_m2[:, None] + WIDTHS_M2
    errors[1], variances[1] = _head(observations)
    normal = np.exp(errors * errors / variances * -0.5) / np.sqrt(variances)
    densities = normal * ((1 - OUTLIERS) / math.sqrt(2 * math.pi)) + OUTLIERS / SPANS
    densities[np.isnan(errors[..., 0])] = 1.0
    return densities


def _head(observations: YawObservations) -> tuple[F64, F64]:
    """Return error and variance of the head, which may be turned relative to the chest."""
    forward, left = observations.ears_m / EARS_M, observations.nose_m / NOSE_M
    size = np.maximum(np.hypot(forward, left), 0.3)
    error_rad = wrap_each(np.arctan2(left, forward)[:, None] - ANGLES)
    return error_rad, (SIGMA_HEAD_RAD**2 + (SIGMA_FACE / size) ** 2)[:, None]


def best_angles(log_p: F64) -> tuple[F64, F64]:
    """Return the most likely angle of each row and its standard deviation, infinite for a flat row.

    Both use only the angles around the best one. A small probability elsewhere, for example of the
    opposite direction, is left to the filter over time; a larger one increases the variance.
    """
    most = log_p.max(axis=1, keepdims=True)
    p = np.exp(log_p - most)
    p /= p.sum(axis=1, keepdims=True)
    best = p.argmax(axis=1)
    off = OFFSETS[best]
    near_p = p * NEAR[best]
    total = near_p.sum(axis=1)
    mean = (near_p * off).sum(axis=1) / total
    variance = (near_p * np.square(off - mean[:, None])).sum(axis=1) / total
    variance += np.maximum(1 - total - FAR_MAX, 0.0) * math.pi**2
    # Rounding to the grid adds a variance of step^2 / 12.
    sigma_rad = np.sqrt(variance + math.radians(STEP_DEG) ** 2 / 12)
    is_flat = most[:, 0] - log_p.min(axis=1) < 1e-9
    return ANGLES[best] + mean, np.where(is_flat, np.inf, sigma_rad)


def sigma_factors(observations: YawObservations) -> F64:
    """Return the factors of sigma for low confidence of the joints."""
    side = observations.side
    unsure = (side > 0) & (side < SIDE_CONFIDENCE)
    return np.where(unsure, SIDE_CONFIDENCE / np.where(unsure, side, 1.0), 1.0)
