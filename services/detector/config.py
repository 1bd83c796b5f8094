"""Configuration of the detector."""

from typing import Literal

import msgspec

from services.detector.models.base import ModelSettings
from services.detector.orientation.orientation import FaceRule, OrientationRule
from services.detector.position.certainty import CertaintyRule
from services.detector.position.position import KeypointRule
from services.detector.position.silhouette import GrowthRule
from services.detector.position.torso import TorsoRule
from services.detector.position.trunk import TrunkRule

# Rules for models that need others than the paper's, by the start of the model's name. MoveNet is
# less confident: two thirds of its keypoints on real pictures lie below 0.6, and down to 0.3 they
# still agree with YOLOv8's. In the simulated room this rule takes the standard deviation of the
# position from 0.071 to 0.048 m in depth and from 0.089 to 0.028 m in height.
KEYPOINT_RULES = {
    "movenet": KeypointRule(confidence_min=0.3, window_px=5, torso_gap_max_m=0.6),
}

# MoveNet is as confident of a hidden ear as of one it sees: by visibility it tells the side of 370
# views in the simulated room no better than a coin does, by the nose in 96 of 100 views.
FACE_RULES = {"movenet": FaceRule(cue="nose", confidence_min=0.3)}


class DetectorConfig(ModelSettings, frozen=True, kw_only=True):
    """What the detector can be told, beside the settings of its model."""

    # How a person's position is read from depth (method book section 2). "auto": at the mask's
    # centroid if the model gives masks, else as the mean of the keypoints; "mask" and "keypoints":
    # only so; "grown": at the centroid of a mask grown in depth from the keypoints (section 8.2),
    # which is sent as the person's mask; "torso": as the middle of shoulders and hips, with windows
    # of depth on the trunk, in the layer that the person is in (this project's); of models without
    # keypoints the upper middle of the mask.
    position: Literal["auto", "mask", "keypoints", "grown", "torso"] = "auto"
    to_axis: bool = False  # positions are moved from the surface to the body's axis; section 2: no
    covariance: bool = False  # tell how sure each position is (this project's)
    keypoint_confidence_min: float | None = None  # 0 to 1 (section 2: 0.6); absent: suits the model
    keypoint_window_px: int | None = None  # [px] odd window of a keypoint's depth; absent: suits
    torso_gap_max_m: float | None = None  # [m] keypoint to torso in depth; absent: suits the model
    orientation: OrientationRule = OrientationRule()  # way the chest faces (section 6)
    growth: GrowthRule = GrowthRule()  # how a "grown" mask grows (section 8.2)
    torso: TorsoRule = TorsoRule()  # how the position "torso" is read
    trunk: TrunkRule = TrunkRule()  # size of the body for to_axis
    certainty: CertaintyRule = CertaintyRule()  # of covariance
    crops: bool = True  # send the pictures of people that re-identification needs
    crop_height_max_px: int = 256  # [px] higher crops are scaled down to this height

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            ValueError: A value is out of range.
        """
        super().__post_init__()
        self.keypoint_rule("")
        if not 16 <= self.crop_height_max_px <= 4096:
            raise ValueError(
                f"crop_height_max_px: expected 16 to 4096, got {self.crop_height_max_px}"
            )

    def keypoint_rule(self, model: str) -> KeypointRule:
        """Return which keypoints make a position: as told, else as suits the model of that name."""
        rules = [rule for name, rule in KEYPOINT_RULES.items() if model.startswith(name)]
        rule = rules[0] if rules else KeypointRule()
        told = {
            "confidence_min": self.keypoint_confidence_min,
            "window_px": self.keypoint_window_px,
            "torso_gap_max_m": self.torso_gap_max_m,
        }
        return msgspec.structs.replace(rule, **{k: v for k, v in told.items() if v is not None})

    def orientation_rule(self, model: str) -> OrientationRule:
        """Return how the way a person faces is read; the face as told, else as suits the model."""
        rules = [rule for name, rule in FACE_RULES.items() if model.startswith(name)]
        face = self.orientation.face or (rules[0] if rules else FaceRule())
        return msgspec.structs.replace(self.orientation, face=face)
