"""Yaw by the joint likelihood of all that one frame shows (docs/method.md section 11).

At every angle a body has a known appearance: the distances of shoulders and hips across the line of
sight and along it, and the nose between the ears. The yaw is the angle under which the observation
is most likely. Angles count from the line of sight: 0 is facing away, pi facing the camera, + is to
the left.

Each measurement is informative at different angles: distances across the line of sight are exact in
profile, differences in depth from the front or from behind, and the face separates the sides. No
choice between them is needed: an uninformative likelihood is flat.
"""

import math
from collections.abc import Iterator
from functools import cache

import numpy as np

from common.geometry.transforms import wrap, wrap_each
from people4d.messages import F32, F64
from services.detector.orientation.angle import YawEstimate
from services.detector.orientation.config import BodyModelConfig, JointPairConfig
from services.detector.orientation.observation import YawObservations, observe_bodies
from services.detector.position.surface import DepthImage

STEP_DEG = 3
ANGLES: F64 = np.radians(np.arange(-180, 180, STEP_DEG))
SINE, COSINE = np.sin(ANGLES), np.cos(ANGLES)
FROM_BEHIND = (1 + COSINE) / 2
NEAR_RAD = math.radians(60)  # mean and variance are those of the angles so near to the best
FAR_MAX = 0.1  # probability that may lie elsewhere
SPAN_M = 1.0  # [m] range of distances between joints that are outliers
SWAPPED_MAX = 0.5  # probability that left and right are taken for each other, at most
SIGMA_MAX_RAD = math.pi / 2  # a less certain angle is not estimated


def joint_yaws(
    keypoints: F32,
    layers_m: F64,
    image: DepthImage,
    config: BodyModelConfig,
    by_image: F64 | None = None,
) -> list[YawEstimate | None]:
    """Estimate the yaws of N people from all cues at once.

    Arguments are as of `observe_bodies`; `by_image` is the log likelihood of `ANGLES` by the images
    of the people, NxA, see `OrientationNetwork`.
    """
    observations = observe_bodies(keypoints, layers_m, image, config)
    log_p = log_likelihood(observations, image.info.fx, config)
    if by_image is not None:
        log_p += by_image
    best_rad, sigma_rad = best_angles(log_p)
    sigma_rad *= sigma_factors(observations, config)
    yaws_rad = best_rad + observations.ray_rad
    return [
        YawEstimate(wrap(yaw), sigma) if sigma < SIGMA_MAX_RAD else None
        for yaw, sigma in zip(yaws_rad.tolist(), sigma_rad.tolist(), strict=True)
    ]


def log_likelihood(observations: YawObservations, fx: float, config: BodyModelConfig) -> F64:
    """Return the logarithm of the likelihood of each of `ANGLES`, NxA; fx in pixels."""
    flat = np.zeros((len(observations.z_m), len(ANGLES)))
    total: F64 = sum(_cues(observations, fx, config), flat)
    # A network that is less confident of the joints of a side takes it for the other more often
    factors = sigma_factors(observations, config)[:, None]
    swapped = np.minimum(config.swapped * factors**2, SWAPPED_MAX)
    turned = np.roll(total, len(ANGLES) // 2, axis=1)
    total = np.logaddexp(np.log1p(-swapped) + total, np.log(swapped) + turned)
    if config.use_confidence:
        total += _face_confidence(observations, config)
    return total


@cache
def across(pair: JointPairConfig) -> F64:
    """Return the expected distance from the left joint to the right one, to the right, by angle.

    w cos(psi), less in profile, where the nearer joint is marked ahead of the other.
    """
    expected_m: F64 = pair.width_m * COSINE - pair.ahead_m * SINE**2
    return expected_m


def across_sigma(pair: JointPairConfig, z_m: F64, fx: float, config: BodyModelConfig) -> F64:
    """Return the standard deviation of `across`, NxA: of joints, pixels and widths of people."""
    joints_m = np.hypot(pair.sigma_across_m, math.sqrt(2) * config.joint_px * z_m / fx)
    return np.hypot(joints_m[:, None], config.sigma_width * pair.width_m * COSINE)


@cache
def along(pair: JointPairConfig, hiding_m: float) -> F64:
    """Return the expected depth of the surface at the right joint, less that at the left, by angle.

    Joints differ by w sin(psi). That is measured as far as the joints are apart across the line of
    sight: in profile, both pixels show the nearer arm.
    """
    gain = pair.gain_front + (pair.gain_back - pair.gain_front) * FROM_BEHIND
    hidden = np.exp(-((pair.width_m * COSINE / hiding_m) ** 2))
    expected_m: F64 = gain * pair.width_m * SINE * (1 - hidden)
    return expected_m


def _cues(observations: YawObservations, fx: float, config: BodyModelConfig) -> Iterator[F64]:
    """Yield the log likelihoods by shoulders, hips and head, NxA."""
    z_m = observations.z_m
    pairs = {"shoulders": config.shoulders} if config.use_shoulders else {}
    pairs |= {"hips": config.hips} if config.use_hips else {}
    for name, pair in pairs.items():
        offsets = observations.pairs[name]
        sigma_m = across_sigma(pair, z_m, fx, config)
        error_m = offsets.across_m[:, None] - across(pair)
        yield _log(error_m, sigma_m, config.outliers_across, SPAN_M)
        if config.use_depth:
            noise_m = np.hypot(pair.sigma_along_m, config.depth_per_m * z_m**2)
            error_m = offsets.along_m[:, None] - along(pair, config.hiding_m)
            yield _log(error_m, noise_m[:, None], config.outliers_along, SPAN_M)
    if config.use_head:
        yield _head(observations, config)


def _head(observations: YawObservations, config: BodyModelConfig) -> F64:
    """Return the log likelihood by the head, which is turned on the chest at times."""
    forward, left = observations.ears_m / config.ears_m, observations.nose_m / config.nose_m
    size = np.maximum(np.hypot(forward, left), 0.3)
    sigma_rad = np.hypot(config.sigma_head_rad, config.sigma_face / size)
    error_rad = wrap_each(np.arctan2(left, forward)[:, None] - ANGLES)
    return _log(error_rad, sigma_rad[:, None], config.outliers_head, 2 * math.pi)


def _face_confidence(observations: YawObservations, config: BodyModelConfig) -> F64:
    """Return the log likelihood by the network's confidence of the face."""
    expected = config.face_front + (config.face_back - config.face_front) * FROM_BEHIND
    error, sigma = observations.face[:, None] - expected, np.array(config.sigma_confidence)
    return _log(error, sigma, config.outliers_confidence, 1.0)


def _log(error: F64, sigma: F64, outliers: float, span: float) -> F64:
    """Return the log density of errors: normal, a fraction of outliers uniform; 0 if unknown."""
    normal = np.exp(-np.square(error / sigma) / 2) * ((1 - outliers) / math.sqrt(2 * math.pi))
    density = np.log(normal / sigma + outliers / span)
    return np.where(np.isnan(error[:, :1]), 0.0, density)


def best_angles(log_p: F64) -> tuple[F64, F64]:
    """Return the most likely angle of each row and its standard deviation, infinite of a flat one.

    Both are those of the angles around the best one. A small probability elsewhere, the other way
    round for example, is left to the filter over time; more than that increases the variance.
    """
    p = np.exp(log_p - log_p.max(axis=1, keepdims=True))
    p /= p.sum(axis=1, keepdims=True)
    best_rad = ANGLES[p.argmax(axis=1)]
    off = wrap_each(ANGLES - best_rad[:, None])
    near_p = np.where(np.abs(off) <= NEAR_RAD, p, 0.0)
    total = near_p.sum(axis=1)
    mean = (near_p * off).sum(axis=1) / total
    variance = (near_p * np.square(off - mean[:, None])).sum(axis=1) / total
    variance += np.maximum(1 - total - FAR_MAX, 0.0) * math.pi**2
    # The grid has a variance of its own.
    sigma_rad = np.sqrt(variance + math.radians(STEP_DEG) ** 2 / 12)
    return best_rad + mean, np.where(np.ptp(log_p, axis=1) < 1e-9, np.inf, sigma_rad)


def sigma_factors(observations: YawObservations, config: BodyModelConfig) -> F64:
    """Return the factors by which sigma grows where the network is not confident of the joints."""
    least, side = config.side_confidence_min, observations.side
    unsure = (side > 0) & (side < least)
    return np.where(unsure, (least / np.where(unsure, side, 1.0)) ** config.side_power, 1.0)
