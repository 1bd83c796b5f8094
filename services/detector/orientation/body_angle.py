"""Which way a person faces, by all that one frame shows at once.

For every angle it is known how a body looks: how far apart shoulders and hips are across the line
of sight and along it, and where the nose is between the ears. The way faced is the angle under
which what is seen is most likely. Angles count from the line of sight, as in `orientation`: 0 is
facing away, pi facing the camera, + is to the left.

Each measurement tells different things at different angles: distances across the line of sight are
exact in profile, differences in depth from the front or from behind, and the face tells one side
from the other. Nothing has to be chosen between them: what does not tell is flat.
"""

import math

import msgspec
import numpy as np
import numpy.typing as npt

from common.geometry.transforms import wrap
from people4d.messages import F64
from services.detector.orientation.body_look import HIPS, SHOULDERS, Look, PairRule, expect_positive

STEP_DEG = 3
ANGLES: F64 = np.radians(np.arange(-180, 180, STEP_DEG))
SINE, COSINE = np.sin(ANGLES), np.cos(ANGLES)
NEAR_RAD = math.radians(60)  # mean and spread are those of the angles so near to the best
FAR_MAX = 0.1  # share of the likelihood that may lie elsewhere
SPAN_M = 1.0  # [m] range of distances between joints that are not this person's


class BodyRule(msgspec.Struct, frozen=True, kw_only=True):
    """How a body looks; each part can be switched off.

    All values are this project's, fitted to films of the simulated room for tuning.
    """

    use_shoulders: bool = True
    use_hips: bool = True
    use_depth: bool = True  # of shoulders and hips; off: only how far apart they are in the image
    use_head: bool = True
    # Networks are surer of a face that they see. That helps less than it errs, so it is not used
    use_confidence: bool = False
    shoulders: PairRule = SHOULDERS
    hips: PairRule = HIPS
    # [m] of two joints less far apart than that across the line of sight, the nearer one's arm or
    # thigh hides the other, whose pixel then shows the depth of the nearer one
    hiding_m: float = 0.145
    sigma_width: float = 0.07  # standard deviation of people's widths, as a share
    joint_px: float = 2.1  # [px] of a joint in the image
    depth_per_m: float = 0.0025  # [1/m] of a difference in depth, over z^2
    reach_m: float = 0.35  # [m] readings farther from the person's layer do not count
    nose_m: float = 0.08  # [m] nose ahead of the ears, as a network marks them
    ears_m: float = 0.125  # [m] between the ears, likewise
    sigma_face: float = 0.3  # of the nose's place, over nose_m
    sigma_head_rad: float = 0.3  # [rad] of the head turned on the chest
    # Mean confidence of the face's points, from the front and from behind: MoveNet's
    face_front: float = 0.61
    face_back: float = 0.49
    sigma_confidence: float = 0.06
    # A network that is not sure of all points of a side errs more: sigma grows from here downward
    side_sure: float = 0.6
    side_power: float = 2.0
    turned: float = 0.03  # share of people whose left and right are taken for each other
    # Share of measurements that tell nothing: joints of another person, joints that were guessed
    outliers_across: float = 0.05
    outliers_along: float = 0.08
    outliers_head: float = 0.1
    outliers_confidence: float = 0.1

    def __post_init__(self) -> None:
        """Check the ranges."""
        expect_positive(self, "hiding_m", "sigma_width", "joint_px", "depth_per_m", "reach_m")
        expect_positive(self, "nose_m", "ears_m", "sigma_face", "sigma_head_rad")
        expect_positive(self, "sigma_confidence", "side_sure")
        shares = ("outliers_across", "outliers_along", "outliers_head", "outliers_confidence")
        for name in (*shares, "turned", "face_front", "face_back"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(f"{name}: expected between 0 and 1, got {getattr(self, name)}")

    def pairs(self) -> dict[str, PairRule]:
        """Return the pairs that are used, by name."""
        used = {"shoulders": self.use_shoulders, "hips": self.use_hips}
        return {name: getattr(self, name) for name, use in used.items() if use}


def log_likelihood(look: Look, fx: float, rule: BodyRule) -> F64:
    """Return the logarithm of the likelihood of each of `ANGLES`.

    Args:
        look: What is seen.
        fx: Focal length in pixels.
        rule: How bodies look.
    """
    total = np.zeros(len(ANGLES))
    for name, pair in rule.pairs().items():
        seen = look.pairs[name]
        sigma_m = across_sigma(pair, look.z_m, fx, rule)
        total += _log(seen.across_m - across(pair), sigma_m, rule.outliers_across, SPAN_M)
        if rule.use_depth:
            noise_m = math.hypot(pair.sigma_along_m, rule.depth_per_m * look.z_m**2)
            behind_m = along(pair, rule.hiding_m)
            total += _log(seen.along_m - behind_m, noise_m, rule.outliers_along, SPAN_M)
    if rule.use_head:
        total += _head(look, rule)
    swapped = np.roll(total, len(ANGLES) // 2)
    total = np.logaddexp(math.log(1 - rule.turned) + total, math.log(rule.turned) + swapped)
    if rule.use_confidence:
        total += _seen_face(look, rule)
    return total


def across(pair: PairRule) -> F64:
    """Return how far to the right of the left joint the right one is seen, at each angle.

    w cos(psi), less in profile, where the nearer joint is marked ahead of the other.
    """
    seen_m: F64 = pair.width_m * COSINE - pair.ahead_m * SINE**2
    return seen_m


def across_sigma(pair: PairRule, z_m: float, fx: float, rule: BodyRule) -> F64:
    """Return the standard deviation of `across`: of joints, pixels and widths of people."""
    joints_m = math.hypot(pair.sigma_across_m, math.sqrt(2) * rule.joint_px * z_m / fx)
    return np.hypot(joints_m, rule.sigma_width * pair.width_m * COSINE)


def along(pair: PairRule, hiding_m: float) -> F64:
    """Return how much farther the right joint's pixel shows the surface, at each angle.

    Joints differ by w sin(psi). That is seen as far as the joints are apart across the line of
    sight: in profile, both pixels show the nearer arm.
    """
    from_behind = (1 + COSINE) / 2
    gain = pair.gain_front + (pair.gain_back - pair.gain_front) * from_behind
    hidden = np.exp(-((pair.width_m * COSINE / hiding_m) ** 2))
    seen_m: F64 = gain * pair.width_m * SINE * (1 - hidden)
    return seen_m


def _head(look: Look, rule: BodyRule) -> F64:
    """Return the log likelihood by the head, which is turned on the chest at times."""
    forward, left = look.ears_m / rule.ears_m, look.nose_m / rule.nose_m
    size = max(math.hypot(forward, left), 0.3)
    sigma_rad = math.hypot(rule.sigma_head_rad, rule.sigma_face / size)
    turned = np.angle(np.exp(1j * (math.atan2(left, forward) - ANGLES)))
    return _log(turned, sigma_rad, rule.outliers_head, 2 * math.pi)


def _seen_face(look: Look, rule: BodyRule) -> F64:
    """Return the log likelihood by how sure the network is of the face."""
    from_behind = (1 + COSINE) / 2
    expected = rule.face_front + (rule.face_back - rule.face_front) * from_behind
    return _log(look.face - expected, rule.sigma_confidence, rule.outliers_confidence, 1.0)


def _log(error: F64, sigma: npt.ArrayLike, outliers: float, span: float) -> F64:
    """Return the log density of errors: normal, a share of outliers uniform; 0 if not known."""
    if np.isnan(error).any():
        return np.zeros(len(ANGLES))
    scale = np.asarray(sigma, np.float64)
    normal = np.exp(-np.square(error / scale) / 2) / (scale * math.sqrt(2 * math.pi))
    density: F64 = np.log((1 - outliers) * normal + outliers / span)
    return density


def best_angle(log_p: F64) -> tuple[float, float] | None:
    """Return the most likely angle and its standard deviation; None if nothing tells.

    Both are those of the angles around the best one. A small share of the likelihood elsewhere,
    the other way round for example, is left to who knows the past; more than that tells that the
    angle is not sure.

    Args:
        log_p: Logarithm of the likelihood of each of `ANGLES`, up to a constant.
    """
    if np.ptp(log_p) < 1e-9:
        return None
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    best = float(ANGLES[int(p.argmax())])
    off = np.angle(np.exp(1j * (ANGLES - best)))
    near = np.abs(off) <= NEAR_RAD
    mean = float(p[near] @ off[near] / p[near].sum())
    variance = float(p[near] @ np.square(off[near] - mean) / p[near].sum())
    variance += max(1 - float(p[near].sum()) - FAR_MAX, 0.0) * math.pi**2
    # Angles are counted in steps, whose own spread comes on top.
    return wrap(best + mean), math.sqrt(variance + math.radians(STEP_DEG) ** 2 / 12)


def doubt(look: Look, rule: BodyRule) -> float:
    """Return by how much sigma grows where the network is not sure of the joints."""
    if not 0 < look.side < rule.side_sure:
        return 1.0
    return float((rule.side_sure / look.side) ** rule.side_power)
