"""Configuration of the detector; docs/method.md has sources and units of the defaults."""

from typing import Annotated, Literal

from msgspec import Meta, field

from common.config import Config
from common.inference.processor import has_integer_dot_products
from common.inference.session import Engine
from people4d.messages.base import Positive, PositiveInt, Ratio
from people4d.messages.people import DETECTIONS_MAX
from people4d.validation import Rule

SIDE_STEP = 32  # divisor of the sides of a network's input, which is halved five times [px]
BODY_NETWORK = "body-lab"  # name of the body network
CONFIDENCE_MIN = 0.6  # minimum confidence of a keypoint [PIC4SeR]
# Name and minimum confidence of MoveNet: on real images two thirds of its keypoints are below 0.6,
# and agree with YOLOv8's down to 0.3
MOVENET, MOVENET_CONFIDENCE_MIN = "movenet", 0.3

Confidence = Annotated[float, Meta(ge=0, lt=1)]
InputSide = Annotated[
    int, Rule(f"a multiple of {SIDE_STEP} or 0", lambda n: n >= 0 and n % SIDE_STEP == 0)
]


def shipped_model() -> str:
    """Return the shipped model for this processor: int8 if it has fast instructions for it."""
    return "movenet-multipose-int8" if has_integer_dot_products() else "movenet-multipose"


def shipped_orientation() -> str:
    """Return the shipped orientation network for this processor, as `shipped_model`."""
    return "orientation-lab-int8" if has_integer_dot_products() else "orientation-lab"


class ModelSettings(Config, frozen=True, kw_only=True):
    """People model and its thresholds."""

    # Name in models/models.toml, or path of an .onnx file; absent: see `shipped_model`
    model: str = field(default_factory=shipped_model)
    kind: str = ""  # one of MODELS or "module:Class"; empty: by the manifest or the file
    # Model of the boxes for an RTMPose network, as `model`; empty: see `shipped_model`
    boxes: str = ""
    folder: str = ""  # folder that is searched first for named models; empty: none
    input_height: InputSide = 0  # [px] height of the network's input; 0: of the file
    input_width: InputSide = 0  # [px] width of the network's input; 0: of the file
    score_min: Ratio | None = None  # minimum score of the network; absent: default of the kind
    # Factor of the network's scores relative to other models of its kind
    score_scale: Positive = 1.0
    # Published scores: "probability" that the detection is a person, or the network's own scores
    scores: Literal["probability", "network"] = "probability"
    iou_max: Ratio | None = None  # maximum overlap of two people; absent: default
    engine: Engine = "onnxruntime"  # "openvino": faster on Intel processors; requires an extra
    threads: PositiveInt = 1  # maximum number of threads of one inference
    # Maximum number of people in one image
    max_people: Annotated[int, Meta(ge=1, le=DETECTIONS_MAX)] = 20

    def __post_init__(self) -> None:
        """Check that height and width are given together."""
        super().__post_init__()
        if (self.input_height == 0) != (self.input_width == 0):
            raise ValueError("input_height, input_width: expected both or neither, got one")


class OrientationConfig(Config, frozen=True, kw_only=True):
    """Yaw of the chest."""

    # "joint": the most likely yaw given all cues (docs/method.md section 11); "separate": circular
    # mean of psi_1 and psi_2 (section 6 [PIC4SeR])
    method: Literal["joint", "separate"] = "joint"
    # Network of "joint": name in the manifest of models, or path of an .onnx file; empty: none;
    # absent: see `shipped_orientation`
    network: str = field(default_factory=shipped_orientation)


class DetectorConfig(ModelSettings, frozen=True, kw_only=True):
    """Configuration of the detector: its model, positions, orientations and crops."""

    # Position of a person from depth. "network": middle of shoulders and hips by the body network
    # (docs/method.md section 10); "mask": centroid of the mask; "keypoints": mean of the keypoints
    # (section 2); "grown": centroid of a mask that is grown in depth from the keypoints and
    # published as the person's mask (section 8.2)
    position: Literal["mask", "keypoints", "grown", "network"] = "network"
    to_axis: bool = True  # True: positions on the surface are moved to the body's axis
    covariance: bool = True  # True: covariances of positions are published
    # [1/m] error of one depth reading, over z^2; default: 0.07 px, 385 px, 50 mm (D435i)
    depth_error_per_m: Positive = 0.0036
    # Minimum confidence of keypoints for positions; absent: by the model
    keypoint_confidence_min: Confidence | None = None
    orientation: OrientationConfig = OrientationConfig()
    crops: bool = True  # True: crops for re-identification are published
    # [px] maximum height of a crop; higher ones are scaled down
    crop_height_max_px: Annotated[int, Meta(ge=16, le=4096)] = 256

    @property
    def orientation_network(self) -> str:
        """Name or path of the orientation network; empty if none is used."""
        return self.orientation.network if self.orientation.method == "joint" else ""

    @property
    def body_network(self) -> str:
        """Name of the body network; empty if none is used."""
        return BODY_NETWORK if self.position == "network" else ""

    def confidence_for(self, model: str) -> float:
        """Return the minimum confidence of keypoints: the setting, else the model's default."""
        if self.keypoint_confidence_min is not None:
            return self.keypoint_confidence_min
        return MOVENET_CONFIDENCE_MIN if model.startswith(MOVENET) else CONFIDENCE_MIN
