"""Configuration of skeletons; values are this project's (docs/method.md section 26)."""

from common.config import Config
from people4d.messages.base import Positive, PositiveInt, Probability


class JointFilterConfig(Config, frozen=True, kw_only=True):
    """Measuring and predicting joints."""

    confidence_min: Probability = 0.1  # of a keypoint
    confident: Probability = 0.5  # confidence from which a keypoint's noise is as below
    # Standard deviation of a keypoint across the line of sight: of the body and of the image
    across_m: Positive = 0.028  # [m]
    across_px: Positive = 2.0  # [px]
    hidden_across_m: Positive = 0.08  # [m] that of a joint that is hidden
    # Standard deviation of a joint along it, behind the surface; grows with the distance squared
    along_m: Positive = 0.04  # [m]
    along_per_m: Positive = 0.003  # [1/m]
    # A reading is the joint's if that is likelier than any other surface within this range
    surfaces_m: Positive = 0.3  # [m]
    outlier_sigmas: Positive = 3.0  # from which a keypoint counts less
    lasts_s: Positive = 0.3  # [s] time constant of a motion against the body
    pose_s: Positive = 0.2  # [s] time in which a hidden joint returns to its usual pose
    bone_m: Positive = 0.03  # [m] standard deviation of a bone's length from frame to frame
    bone_frames: Positive = 10.0  # measurements of a bone that are alike, as they follow closely
    learn_s: Positive = 10.0  # [s] time constant of a person's usual pose


class SkeletonConfig(Config, frozen=True, kw_only=True):
    """Configuration of the service."""

    joints: JointFilterConfig = JointFilterConfig()
    people_max: PositiveInt = 200  # further people have no skeleton
    gap_max_s: Positive = 1.0  # [s] without a frame, after which skeletons begin anew
    away_max_m: Positive = 0.6  # [m] of a torso from its track, beyond which it begins anew
