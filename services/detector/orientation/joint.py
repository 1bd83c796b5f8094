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
import numpy.typing as npt

from common.geometry.transforms import wrap
from people4d.messages import F32, F64
from services.detector.orientation.angle import YawEstimate
from services.detector.orientation.config import BodyModelConfig, JointPairConfig
from services.detector.orientation.observation import YawObservation, observe_body
from services.detector.position.surface import DepthImage

STEP_DEG = 3
ANGLES: F64 = np.radians(np.arange(-180, 180, STEP_DEG))
SINE, COSINE = np.sin(ANGLES), np.cos(ANGLES)
FROM_BEHIND = (1 + COSINE) / 2
NEAR_RAD = math.radians(60)  # mean and variance are those of the angles so near to the best
FAR_MAX = 0.1  # probability that may lie elsewhere
SPAN_M = 1.0  # [m] range of distances between joints that are outliers
SIGMA_MAX_RAD = math.pi / 2  # a less certain angle is not estimated


def joint_yaw(
    keypoints: F32,
    layer_m: float,
    image: DepthImage,
    confidence_min: float,
    config: BodyModelConfig,
) -> YawEstimate | None:
    """Estimate the yaw of a person from all cues at once; arguments as of `observe_body`."""
    observation = observe_body(keypoints, layer_m, image, confidence_min, config)
    best = best_angle(log_likelihood(observation, image.info.fx, config))
    if best is None:
        return None
    sigma_rad = best.sigma_rad * sigma_factor(observation, config)
    if sigma_rad >= SIGMA_MAX_RAD:
        return None
    return YawEstimate(wrap(best.rad + observation.ray_rad), sigma_rad)


def log_likelihood(observation: YawObservation, fx: float, config: BodyModelConfig) -> F64:
    """Return the logarithm of the likelihood of each of `ANGLES`; fx in pixels."""
    total: F64 = sum(_cues(observation, fx, config), np.zeros(len(ANGLES)))
    swapped = np.roll(total, len(ANGLES) // 2)
    total = np.logaddexp(math.log(1 - config.swapped) + total, math.log(config.swapped) + swapped)
    if config.use_confidence:
        total += _face_confidence(observation, config)
    return total


@cache
def across(pair: JointPairConfig) -> F64:
    """Return the expected distance from the left joint to the right one, to the right, by angle.

    w cos(psi), less in profile, where the nearer joint is marked ahead of the other.
    """
    expected_m: F64 = pair.width_m * COSINE - pair.ahead_m * SINE**2
    return expected_m


def across_sigma(pair: JointPairConfig, z_m: float, fx: float, config: BodyModelConfig) -> F64:
    """Return the standard deviation of `across`: of joints, pixels and widths of people."""
    joints_m = math.hypot(pair.sigma_across_m, math.sqrt(2) * config.joint_px * z_m / fx)
    return np.hypot(joints_m, config.sigma_width * pair.width_m * COSINE)


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


def _cues(observation: YawObservation, fx: float, config: BodyModelConfig) -> Iterator[F64]:
    """Yield the log likelihoods by shoulders, hips and head."""
    z_m = observation.z_m
    pairs = {"shoulders": config.shoulders} if config.use_shoulders else {}
    pairs |= {"hips": config.hips} if config.use_hips else {}
    for name, pair in pairs.items():
        offset = observation.pairs[name]
        sigma_m = across_sigma(pair, z_m, fx, config)
        yield _log(offset.across_m - across(pair), sigma_m, config.outliers_across, SPAN_M)
        if config.use_depth:
            noise_m = math.hypot(pair.sigma_along_m, config.depth_per_m * z_m**2)
            error_m = offset.along_m - along(pair, config.hiding_m)
            yield _log(error_m, noise_m, config.outliers_along, SPAN_M)
    if config.use_head:
        yield _head(observation, config)


def _head(observation: YawObservation, config: BodyModelConfig) -> F64:
    """Return the log likelihood by the head, which is turned on the chest at times."""
    forward, left = observation.ears_m / config.ears_m, observation.nose_m / config.nose_m
    size = max(math.hypot(forward, left), 0.3)
    sigma_rad = math.hypot(config.sigma_head_rad, config.sigma_face / size)
    error_rad = np.angle(np.exp(1j * (math.atan2(left, forward) - ANGLES)))
    return _log(error_rad, sigma_rad, config.outliers_head, 2 * math.pi)


def _face_confidence(observation: YawObservation, config: BodyModelConfig) -> F64:
    """Return the log likelihood by the network's confidence of the face."""
    expected = config.face_front + (config.face_back - config.face_front) * FROM_BEHIND
    error = observation.face - expected
    return _log(error, config.sigma_confidence, config.outliers_confidence, 1.0)


def _log(error: F64, sigma: npt.ArrayLike, outliers: float, span: float) -> F64:
    """Return the log density of errors: normal, a fraction of outliers uniform; 0 if unknown."""
    if np.isnan(error).any():
        return np.zeros(len(ANGLES))
    scale = np.asarray(sigma, np.float64)
    normal = np.exp(-np.square(error / scale) / 2) / (scale * math.sqrt(2 * math.pi))
    density: F64 = np.log((1 - outliers) * normal + outliers / span)
    return density


def best_angle(log_p: F64) -> YawEstimate | None:
    """Return the most likely angle and its standard deviation; None of a flat likelihood.

    Both are those of the angles around the best one. A small probability elsewhere, the other way
    round for example, is left to the filter over time; more than that increases the variance.
    """
    if np.ptp(log_p) < 1e-9:
        return None
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    index = int(p.argmax())
    best, off = float(ANGLES[index]), _offsets(index)
    near = np.abs(off) <= NEAR_RAD
    mean = float(p[near] @ off[near] / p[near].sum())
    variance = float(p[near] @ np.square(off[near] - mean) / p[near].sum())
    variance += max(1 - float(p[near].sum()) - FAR_MAX, 0.0) * math.pi**2
    # The grid has a variance of its own.
    return YawEstimate(wrap(best + mean), math.sqrt(variance + math.radians(STEP_DEG) ** 2 / 12))


@cache
def _offsets(index: int) -> F64:
    """Return the angles from one of `ANGLES` to all of them, -pi to pi."""
    off: F64 = np.angle(np.exp(1j * (ANGLES - float(ANGLES[index]))))
    return off


def sigma_factor(observation: YawObservation, config: BodyModelConfig) -> float:
    """Return the factor by which sigma grows where the network is not confident of the joints."""
    if not 0 < observation.side < config.side_confidence_min:
        return 1.0
    return float((config.side_confidence_min / observation.side) ** config.side_power)
