"""How a person detector errs, for sightings without pictures."""

import math

import msgspec

from lab.depth.depth_config import DepthSensorConfig


class SightingConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The errors of a pose network and of the depth it is read with.

    "Measured" is what YOLO11n-pose did on drawn people of about 300 px, 3 to 5 m away: 380 of 381
    who were not hidden found, median keypoint error 3.3 px (1.18 standard deviations), ankles twice
    that. Other values are by eye.
    """

    keypoint_share: float = 0.009  # standard deviation each way, of the box's height; measured
    keypoint_least_px: float = 0.5  # [px] standard deviation that is always there
    ankle_factor: float = 1.8  # ankles are worse by this; measured
    hidden_factor: float = 3.0  # keypoints that are hidden, and guessed, are worse by this
    confidence_seen: float = 0.92  # mean confidence of keypoints that are seen
    confidence_hidden: float = 0.35  # and of those that are hidden or outside of the image
    confidence_sigma: float = 0.05  # standard deviation of both
    box_share: float = 0.01  # standard deviation of each side of the box, of the box's height
    noise_s: float = 0.15  # [s] how long errors last, see `noise.Persistence.correlation_s`
    recall: float = 0.99  # share of people found who are not hidden; measured: 0.99 to 1
    share_full: float = 0.35  # visible share of the body from which they are found so often
    share_none: float = 0.08  # visible share up to which nobody is found; linear between
    height_least_px: float = 25.0  # [px] smaller people are not found
    miss_s: float = 0.1  # [s] how long a miss lasts
    score_full: float = 0.9  # mean score of people from `share_full` on; measured
    score_none: float = 0.35  # mean score at `share_none`; linear between
    score_sigma: float = 0.04  # standard deviation of both
    false_alarms: float = 0.01  # mean number a frame; measured: 0 to 0.01
    false_alarm_s: float = 0.1  # [s] that a false alarm stays
    front_m: float = 0.12  # [m] from the torso's middle to its surface, seen from front or back
    side_m: float = 0.17  # [m] and from the side
    readings: int = 4  # independent readings of depth that make a position: shoulders and hips
    no_position: float = 0.01  # share of people found whose depth cannot be read
    heading_rad: float = 0.3  # [rad] standard deviation; measured: half of all within 11 to 14 deg
    reversals: float = 0.03  # share of headings that are turned round; measured: 0.03
    sensor: DepthSensorConfig = DepthSensorConfig()  # whose noise and range positions have

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            ValueError: A value is out of range.
        """
        for name in ("noise_s", "miss_s", "false_alarm_s", "readings"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected > 0, got {getattr(self, name)}")
        shares = ("recall", "score_full", "score_none", "no_position", "reversals")
        for name in (*shares, "confidence_seen", "confidence_hidden"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name}: expected 0 to 1, got {getattr(self, name)}")
        sizes = ("keypoint_share", "keypoint_least_px", "ankle_factor", "hidden_factor")
        others = ("confidence_sigma", "box_share", "score_sigma", "height_least_px")
        for name in (*sizes, *others, "front_m", "side_m", "heading_rad"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected >= 0, got {getattr(self, name)}")
        if not 0 <= self.share_none < self.share_full <= 1:
            raise ValueError("share_none, share_full: expected 0 <= none < full <= 1")
        if not 0 <= self.false_alarms <= 100:
            raise ValueError(f"false_alarms: expected 0 to 100, got {self.false_alarms}")


FAULTLESS = SightingConfig(
    keypoint_share=0,
    keypoint_least_px=0,
    confidence_sigma=0,
    box_share=0,
    recall=1,
    score_sigma=0,
    false_alarms=0,
    front_m=0,
    side_m=0,
    no_position=0,
    heading_rad=0,
    reversals=0,
    sensor=DepthSensorConfig(noise_px=0),
)  # finds all who are seen, where they are
