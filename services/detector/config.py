"""Configuration of the detector; docs/method.md has sources and units of the defaults."""

from typing import Annotated, Literal

from msgspec import Meta, field

from common.config import Config
from common.inference.processor import has_integer_dot_products
from common.inference.session import Engine
from people4d.messages.base import Positive, PositiveInt, Ratio
from people4d.messages.people import DETECTIONS_MAX
from people4d.validation import Rule

SIDE_STEP = 32  # step of the sides of a network's input, which is halved five times [px]
CONFIDENCE_MIN = 0.6  # minimum confidence of a keypoint [PIC4SeR]
# The same for MoveNet: two thirds of its keypoints on real images lie below 0.6, and down to 0.3
# they still agree with YOLOv8's
MOVENET, MOVENET_CONFIDENCE_MIN = "movenet", 0.3

Confidence = Annotated[float, Meta(ge=0, lt=1)]
InputSide = Annotated[
    int, Rule(f"a multiple of {SIDE_STEP} or 0", lambda n: n >= 0 and n % SIDE_STEP == 0)
]


def shipped_model() -> str:
    """Return the shipped model that suits this processor: int8 if that is fast."""
    return "movenet-multipose-int8" if has_integer_dot_products() else "movenet-multipose"


class ModelSettings(Config, frozen=True, kw_only=True):
    """People model and its thresholds."""

    # Name in models/models.toml, or path of an .onnx file; absent: see `shipped_model`
    model: str = field(default_factory=shipped_model)
    kind: str = ""  # one of MODELS or "module:Class"; empty: as the manifest or the file says
    folder: str = ""  # folder that is searched first for named models; empty: none
    input_height: InputSide = 0  # [px] of the network; 0: as the model is made
    input_width: InputSide = 0  # [px] of the network; 0: as the model is made
    score_min: Ratio | None = None  # minimum of the network's own scores; absent: kind's default
    score_scale: Positive = 1.0  # ratio of the network's scores to the usual ones of its kind
    # Published scores: "probability" that the detection is a person, or the network's own scores
    scores: Literal["probability", "network"] = "probability"
    iou_max: Ratio | None = None  # overlap above which two boxes are one person; absent: default
    engine: Engine = "onnxruntime"  # "openvino": faster on Intel's processors, an extra
    threads: PositiveInt = 1  # threads that one inference may use
    max_people: Annotated[int, Meta(ge=1, le=DETECTIONS_MAX)] = 20  # maximum number in one image

    def __post_init__(self) -> None:
        """Check that height and width are given together."""
        super().__post_init__()
        if (self.input_height == 0) != (self.input_width == 0):
            raise ValueError("input_height, input_width: expected both or neither, got one")


class OrientationConfig(Config, frozen=True, kw_only=True):
    """Yaw of the chest."""

    # "joint": the most likely yaw given all cues at once (docs/method.md section 11); "separate":
    # circular mean of psi_1 and psi_2 (section 6 [PIC4SeR])
    method: Literal["joint", "separate"] = "joint"
    # Network of "joint": name in the manifest of models, or path of an .onnx file; empty: none
    network: str = "orientation-lab"


class DetectorConfig(ModelSettings, frozen=True, kw_only=True):
    """Configuration of the detector: its model, positions, orientations and crops."""

    # Position of a person from depth. "torso": middle of shoulders and hips, from windows of depth
    # in the person's own layer, or upper middle of the mask of a model without keypoints
    # (docs/method.md section 10); "mask": centroid of the mask; "keypoints": mean of the keypoints
    # (section 2); "grown": centroid of a mask that is grown in depth from the keypoints and
    # published as the person's mask (section 8.2)
    position: Literal["mask", "keypoints", "grown", "torso"] = "torso"
    to_axis: bool = True  # positions are moved from the surface to the body's axis
    covariance: bool = True  # publish the covariance of each position
    velocity: bool = True  # publish the velocity of each person
    # [1/m] error of one depth reading, over z^2; default: 0.07 px, 385 px, 50 mm (D435i)
    depth_error_per_m: Positive = 0.0036
    keypoint_confidence_min: Confidence | None = None  # for positions; absent: by the model
    orientation: OrientationConfig = OrientationConfig()
    crops: bool = True  # publish the crops that re-identification needs
    crop_height_max_px: Annotated[int, Meta(ge=16, le=4096)] = 256  # [px] higher: scaled down

    @property
    def orientation_network(self) -> str:
        """Name or path of the orientation network; empty if none is used."""
        return self.orientation.network if self.orientation.method == "joint" else ""

    def confidence_for(self, model: str) -> float:
        """Return the confidence that keypoints must exceed: as set, else as suits the model."""
        if self.keypoint_confidence_min is not None:
            return self.keypoint_confidence_min
        return MOVENET_CONFIDENCE_MIN if model.startswith(MOVENET) else CONFIDENCE_MIN
