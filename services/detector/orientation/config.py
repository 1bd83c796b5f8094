"""Configuration of the orientation of people. docs/method.md has sources and units."""

from typing import Annotated, Literal

from msgspec import Meta

from common.config import Config
from people4d.messages.base import Positive

Confidence = Annotated[float, Meta(ge=0, lt=1)]
Fraction = Annotated[float, Meta(gt=0, lt=1)]


class FaceConfig(Config, frozen=True, kw_only=True):
    """Side to which a person is turned, by the face; docs/method.md section 6 [PIC4SeR]."""

    # "visible": by the visible eyes and ears (eq. 4.17). "nose": by the side of the ears' middle
    # that the nose is on, for models as confident of hidden points as of visible ones (this
    # project's). "none": the sign is that of psi_1.
    cue: Literal["visible", "nose", "none"] = "visible"
    confidence_min: Confidence = 0.5  # of visible eyes, ears and nose; this project's
    nose_offset_min: Positive = 0.05  # nose to the ears' middle, of the torso's height; likewise


class JointPairConfig(Config, frozen=True, kw_only=True):
    """Appearance of the shoulders or the hips; docs/method.md section 11."""

    width_m: Positive  # [m] between both, as a network marks them
    ahead_m: Positive  # [m] in profile the nearer one is marked so much ahead of the farther one
    gain_front: Positive  # depth difference of the surface over that of the joints, from the front
    gain_back: Positive  # likewise, from behind
    window_m: Positive  # [m] side of the window whose median is a joint's depth
    sigma_across_m: Positive = 0.04  # [m] of the distance across the line of sight
    sigma_along_m: Positive  # [m] of the difference in depth


# Shoulder joints are about 0.19 of stature apart, hips are marked on the outside of their joints,
# which are 0.1 apart. Fitted to renders of the simulated room, with BodyModelConfig.
SHOULDERS = JointPairConfig(
    width_m=0.32, ahead_m=0.01, gain_front=0.87, gain_back=0.63, window_m=0.1, sigma_along_m=0.04
)
HIPS = JointPairConfig(
    width_m=0.21, ahead_m=0.04, gain_front=0.83, gain_back=0.67, window_m=0.2, sigma_along_m=0.035
)


class BodyModelConfig(Config, frozen=True, kw_only=True):
    """Appearance of a body by its yaw; docs/method.md section 11. Each part can be switched off.

    All values are this project's, fitted to renders of the simulated room for tuning.
    """

    # Keypoints must be more confident than this, positions need more: those of little confidence
    # are mostly right, and the yaw is less certain with them
    confidence_min: Confidence = 0.1
    use_shoulders: bool = True
    use_hips: bool = True
    use_depth: bool = True  # of shoulders and hips; off: only their distance in the image
    use_head: bool = True
    # Networks are more confident of a visible face. That helps less than it errs: not used
    use_confidence: bool = False
    shoulders: JointPairConfig = SHOULDERS
    hips: JointPairConfig = HIPS
    # [m] of two joints less far apart than that across the line of sight, the nearer one's arm or
    # thigh hides the other, whose pixel then shows the depth of the nearer one
    hiding_m: Positive = 0.145
    sigma_width: Positive = 0.07  # standard deviation of people's widths, relative
    joint_px: Positive = 2.1  # [px] of a joint in the image
    depth_per_m: Positive = 0.0025  # [1/m] of a difference in depth, over z^2
    reach_m: Positive = 0.35  # [m] readings farther from the person's layer do not count
    nose_m: Positive = 0.08  # [m] nose ahead of the ears, as a network marks them
    ears_m: Positive = 0.125  # [m] between the ears, likewise
    sigma_face: Positive = 0.3  # of the nose, over nose_m
    sigma_head_rad: Positive = 0.3  # [rad] of the head turned on the chest
    # Mean confidence of the face's points, from the front and from behind: MoveNet's
    face_front: Fraction = 0.61
    face_back: Fraction = 0.49
    sigma_confidence: Positive = 0.06
    # A network that is less confident of all points of a side errs more: sigma grows below this
    side_confidence_min: Positive = 0.6
    side_power: float = 1.0
    swapped: Fraction = 0.03  # probability that left and right are taken for each other
    # Outlier probabilities: joints of another person, joints that were guessed
    outliers_across: Fraction = 0.05
    outliers_along: Fraction = 0.08
    outliers_head: Fraction = 0.1
    outliers_confidence: Fraction = 0.1


class OrientationNetworkConfig(Config, frozen=True, kw_only=True):
    """Yaw by the image of the upper body, as one more cue of "joint"; docs/method.md section 11."""

    # Name in the manifest of models, or path of an .onnx file; empty: there is none
    model: str = "orientation-lab"
    # Exponent of its probabilities; less than 1 if image and keypoints err together
    weight: Annotated[float, Meta(gt=0, le=1)] = 1.0
    outliers: Fraction = 0.05  # probability of an image that shows something else


class OrientationConfig(Config, frozen=True, kw_only=True):
    """Yaw of the chest from keypoints; each part can be switched off."""

    # "joint": the most likely yaw of all cues together (docs/method.md section 11). "separate":
    # psi_1 and psi_2, then their mean (section 6 [PIC4SeR]), with the following settings
    method: Literal["joint", "separate"] = "joint"
    vector: bool = True  # psi_1, from shoulders or hips in 3D; eq. 4.12
    ratio: bool = True  # psi_2, from proportions in the image; eq. 4.13 to 4.16
    ray: bool = True  # psi_2 counts from the line of sight; off: from the axis
    weighted: bool = True  # psi_1 and psi_2 count by 1 / sigma^2, else equally [PIC4SeR]
    face: FaceConfig | None = None  # sign of psi_2; absent: suits the model
    baseline_min_m: Positive = 0.1  # [m] a shorter pair hides one of its points
    shoulder_ratio_max: Positive = 0.90  # largest shoulder width over torso height
    hip_ratio_max: Positive = 0.66  # largest hip width over torso height
    torso_min_px: Positive = 8.0  # [px] a lower torso has no readable proportions; this project's
    # Standard deviations, from the simulated room; this project's
    sigma_point_m: Positive = 0.05  # [m] each point of the pair, across the pair
    sigma_ratio: Positive = 0.18  # ratio over the largest ratio
    body: BodyModelConfig = BodyModelConfig()  # of "joint"
    network: OrientationNetworkConfig = OrientationNetworkConfig()  # of "joint"
