"""Configuration of the detector. Defaults are what ships; docs/method.md has sources and units."""

import math
from typing import Annotated, Literal, TypeVar

import msgspec
from msgspec import Meta, field

from common.config import Config
from common.inference.processor import has_integer_dot_products
from common.inference.session import Engine
from people4d.messages.base import (
    NonNegative,
    Positive,
    PositiveInt,
    PositiveOrInfinite,
    PositiveRatio,
    Ratio,
)
from people4d.messages.people import DETECTIONS_MAX
from people4d.validation import Rule
from services.detector.orientation.config import Confidence, FaceConfig, OrientationConfig

T = TypeVar("T")

SIDE_STEP = 32  # [px] the networks halve the image five times

AboveOne = Annotated[float, Meta(gt=1)]
OddWindow = Annotated[int, Rule("an odd number, 1 to 31", lambda n: 1 <= n <= 31 and n % 2 == 1)]
InputSide = Annotated[
    int, Rule(f"a multiple of {SIDE_STEP} or 0", lambda n: n >= 0 and n % SIDE_STEP == 0)
]


def shipped_model() -> str:
    """Return the model that ships and suits this processor: of integers where they are fast."""
    return "movenet-multipose-int8" if has_integer_dot_products() else "movenet-multipose"


class ModelSettings(Config, frozen=True, kw_only=True):
    """People model and its thresholds."""

    # Name in models/models.toml, or path of an .onnx file; absent: see `shipped_model`
    model: str = field(default_factory=shipped_model)
    kind: str = ""  # one of MODELS or "module:Class"; empty: as the manifest or the file says
    folder: str = ""  # folder that is searched first for named models; empty: none
    input_height: InputSide = 0  # [px] of the network; 0: as the model is made
    input_width: InputSide = 0  # [px] of the network; 0: as the model is made
    score_min: Ratio | None = None  # of the network's own scores, least; absent: the kind's default
    # Scores of this network are so many times those of its kind, as of one of integers
    score_scale: Positive = 1.0
    # Published scores: "probability" that the detection is a person, or those of the network
    scores: Literal["probability", "network"] = "probability"
    iou_max: Ratio | None = None  # overlap above which two boxes are one person; absent: default
    engine: Engine = "onnxruntime"  # "openvino": faster on Intel's processors, an extra
    threads: PositiveInt = 1  # threads that one inference may use
    max_people: Annotated[int, Meta(ge=1, le=DETECTIONS_MAX)] = 20  # in one image, best first

    def __post_init__(self) -> None:
        """Check that height and width are given together."""
        super().__post_init__()
        if (self.input_height == 0) != (self.input_width == 0):
            raise ValueError("input_height, input_width: expected both or neither, got one")


class KeypointConfig(Config, frozen=True, kw_only=True):
    """Keypoints that make a position; docs/method.md section 2 [PIC4SeR]."""

    confidence_min: Confidence = 0.6  # keypoints must be more confident than this
    window_px: OddWindow = 1  # [px] side of the window whose median depth is read
    torso_gap_max_m: PositiveOrInfinite = math.inf  # [m] farther from the torso: does not count


class GrowthConfig(Config, frozen=True, kw_only=True):
    """Region growing of a mask in depth; docs/method.md sections 2 and 8.2."""

    step_min_m: Positive = 0.01  # [m] neighbours whose depths differ by less are connected
    step_per_m2: NonNegative = 0.01  # [1/m] the step grows to this times the squared distance
    reach_m: Positive = 0.4  # [m] pixels farther from the torso's depth are not the person's
    confidence_min: Confidence = 0.3  # of keypoints that are seeds


class LayerConfig(Config, frozen=True, kw_only=True):
    """Depth layer of a person; docs/method.md section 10."""

    half_m: Positive = 0.25  # [m] readings farther from the middle of the layer do not count
    size_sigma: Positive = 0.2  # standard deviation of the logarithm of people's size
    misfit: PositiveRatio = 0.02  # least weight of a layer by the size of the person
    beside_m: NonNegative = 0.5  # [m] between two people of whom one looks out behind the other
    larger_max: AboveOne = 2.0  # layers where a person would be so many times too large are refused
    smaller_max: AboveOne = 2.2  # likewise too small, by the height of the torso
    other_weight: PositiveRatio = 0.5  # weight of samples that are not on the torso
    area_weight: NonNegative = 2.0  # weight of all samples of the visible area together
    missing_weight: Ratio = 0.5  # weight of samples without a reading as a layer beyond the range
    # Least part of all samples, times the weight by size, of a layer that is the person's; 0.005:
    # of a person who appears half as large as people are a quarter of the samples
    score_min: Ratio = 0.005


class AreaConfig(Config, frozen=True, kw_only=True):
    """Visible area of a body, by box and joints; docs/method.md section 10."""

    columns: PositiveInt = 6  # samples of depth across
    rows: PositiveInt = 8  # samples of depth downward
    width: PositiveRatio = 0.5  # of the box, in its middle or at the edge that cuts it off
    edge_ratio: Ratio = 0.02  # of the image's width: a box so near to its edge is cut off there
    below_top: Confidence = 0.3  # of the box's height: its upper edge where no shoulder is known
    # Torso of people of whom no joint is known, by their box
    crown_m: Positive = 0.55  # [m] box's upper edge to the middle of the torso
    sigma_m: Positive = 0.15  # [m] standard deviation of the middle, across the line of sight


class ProportionConfig(Config, frozen=True, kw_only=True):
    """Positions of joints; the mean of simulated women and men of 1.55 to 1.90 m."""

    half_shoulders_m: Positive = 0.16  # [m] middle of the torso to a shoulder's joint, sideways
    half_hips_m: Positive = 0.10  # [m] to a hip's joint, sideways
    half_height_m: Positive = 0.25  # [m] to shoulders or hips, upright; 0.288 H / 2 [Winter 2009]
    sigma_lean: Positive = 0.2  # of the upright, 1 = 45 deg, and of stature
    sigma_turn: Positive = 0.3  # of the sideways direction where the yaw is known


class TorsoConfig(Config, frozen=True, kw_only=True):
    """Position of the torso from its joints; docs/method.md section 10."""

    pull: Confidence = 0.3  # fraction from a joint to the torso's middle: off the outline
    edge_px: NonNegative = 8.0  # [px] joints so near to the image's edge are guesses: cut off
    window_share: PositiveRatio = 0.12  # side of a window, of the torso's diagonal in the image
    window_max_px: Annotated[int, Meta(ge=5, le=101)] = 31  # [px] largest side of a window
    margin_share: PositiveRatio = 0.25  # outline beyond the keypoints, of the torso's diagonal
    layer: LayerConfig = LayerConfig()
    area: AreaConfig = AreaConfig()
    proportions: ProportionConfig = ProportionConfig()
    # Axis behind face and limbs, where the torso itself is hidden
    limb_offset_m: NonNegative = 0.06  # [m]
    limb_sigma_m: Positive = 0.1  # [m] standard deviation of that


class EllipseConfig(Config, frozen=True, kw_only=True):
    """Cross section of the torso; adults differ by about a tenth.

    Source: docs/method.md section 10: half the chest depth, and half the mean of shoulder and hip
    breadth, of adults (about 0.25, 0.47 and 0.34 m); clothes are not counted.
    """

    half_depth_m: PositiveRatio = 0.125  # [m] axis to chest
    half_width_m: PositiveRatio = 0.205  # [m] axis to side, arms included


class UncertaintyConfig(Config, frozen=True, kw_only=True):
    """Standard deviations of positions; depth as of a D435i, the others from simulated people."""

    depth_per_m: Positive = 0.0036  # [1/m] of a reading, over z^2: 0.07 px, 385 px, 50 mm
    body_m: Positive = 0.035  # [m] along the line of sight: bodies, clothes, arms before the torso
    joint_m: Positive = 0.04  # [m] across: a joint, of near people
    joint_px: Positive = 2.0  # [px] across: a joint, of far people
    # Centroids of masks and means of keypoints, from the torso:
    centroid_m: Positive = 0.04  # [m] across
    centroid_down_m: Positive = 0.2  # [m] downward
    surface_m: Positive = 0.16  # [m] along: the surface, where it is not corrected


class VelocityConfig(Config, frozen=True, kw_only=True):
    """Velocity of a person by scene flow; docs/method.md section 10."""

    enabled: bool = True  # publish velocities
    interval_max_s: Positive = 0.25  # [s] longest time between two frames
    sigma_px: Positive = 0.3  # [px] standard deviation of movements across
    spread_part: NonNegative = 0.7  # of the spread of a torso's points, on top of that
    depth_per_m: Positive = 0.0032  # [1/m] of movements along, over z^2


# Values for models that need others than those of [PIC4SeR], by the start of the model's name.
# MoveNet is less confident: two thirds of its keypoints on real images lie below 0.6, and down to
# 0.3 they still agree with YOLOv8's. In the simulated room this takes the standard deviation of
# positions from 0.071 to 0.048 m in depth and from 0.089 to 0.028 m in height.
MODEL_KEYPOINTS = {
    "movenet": KeypointConfig(confidence_min=0.3, window_px=5, torso_gap_max_m=0.6),
}

# MoveNet is as confident of a hidden ear as of a visible one: by visibility it gives the side of
# 370 views in the simulated room no better than a coin, by the nose in 96 of 100 views.
MODEL_FACES = {"movenet": FaceConfig(cue="nose", confidence_min=0.3)}


class NearInputConfig(Config, frozen=True, kw_only=True):
    """Smaller input of the network while all people in view are near; docs/methods/models.md."""

    height: InputSide = 0  # [px] of the smaller input; 0: every frame gets the full one
    width: InputSide = 0  # [px] likewise
    person_min_px: Positive = 100.0  # [px] least height of a near person in the smaller input
    full_every: Annotated[int, Meta(ge=2)] = 4  # at least each of so many frames is full

    def __post_init__(self) -> None:
        """Check that height and width are given together."""
        super().__post_init__()
        if (self.height == 0) != (self.width == 0):
            raise ValueError("height, width: expected both or neither, got one")


class DetectorConfig(ModelSettings, frozen=True, kw_only=True):
    """Configuration of the detector, beside the settings of its model."""

    near_input: NearInputConfig = NearInputConfig()
    # Position of a person from depth. "torso": middle of shoulders and hips, by windows of depth in
    # the person's own layer, of models without keypoints the upper middle of the mask (docs/
    # method.md section 10); "mask": centroid of the mask; "keypoints": mean of the keypoints
    # (section 2); "auto": "mask" if the model gives masks, else "keypoints"; "grown": centroid of a
    # mask grown in depth from the keypoints, which is published as the person's mask (section 8.2).
    position: Literal["auto", "mask", "keypoints", "grown", "torso"] = "torso"
    to_axis: bool = True  # positions are moved from the surface to the body's axis
    covariance: bool = True  # publish the covariance of each position
    keypoint_confidence_min: Confidence | None = None  # absent: suits the model
    keypoint_window_px: OddWindow | None = None  # [px] window of a keypoint's depth; absent: suits
    torso_gap_max_m: PositiveOrInfinite | None = None  # [m] keypoint to torso; absent: suits
    orientation: OrientationConfig = OrientationConfig()
    growth: GrowthConfig = GrowthConfig()  # of "grown"
    torso: TorsoConfig = TorsoConfig()  # of "torso"
    ellipse: EllipseConfig = EllipseConfig()  # of to_axis
    uncertainty: UncertaintyConfig = UncertaintyConfig()  # of covariance
    velocity: VelocityConfig = VelocityConfig()
    crops: bool = True  # publish the crops that re-identification needs
    # [m] what is so much nearer than the person is blanked in the crop; inf: nothing
    crop_front_m: PositiveOrInfinite = 0.4
    crop_height_max_px: Annotated[int, Meta(ge=16, le=4096)] = 256  # [px] higher: scaled down

    def keypoints_for(self, model: str) -> KeypointConfig:
        """Return the configuration of keypoints: as set, else as suits the model of that name."""
        suited = _suited(MODEL_KEYPOINTS, model) or KeypointConfig()
        values = {
            "confidence_min": self.keypoint_confidence_min,
            "window_px": self.keypoint_window_px,
            "torso_gap_max_m": self.torso_gap_max_m,
        }
        return msgspec.structs.replace(suited, **{k: v for k, v in values.items() if v is not None})

    @property
    def orientation_network(self) -> str:
        """Name or path of the orientation network; empty if none is used."""
        return self.orientation.network.model if self.orientation.method == "joint" else ""

    def orientation_for(self, model: str) -> OrientationConfig:
        """Return the configuration of yaw; the face as set, else as suits the model."""
        face = self.orientation.face or _suited(MODEL_FACES, model) or FaceConfig()
        return msgspec.structs.replace(self.orientation, face=face)


def _suited(configs: dict[str, T], model: str) -> T | None:
    return next((config for name, config in configs.items() if model.startswith(name)), None)
