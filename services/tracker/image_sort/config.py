"""Configuration of SORT in the image; the default values are those of the papers."""

import math
from typing import Literal

import msgspec


class ImageSortConfig(msgspec.Struct, frozen=True, kw_only=True):
    """SORT (Bewley et al., 2016) with the two settings of the odometry paper (section 7).

    The Kalman filter's constants are SORT's and stand in `box_kalman`.
    """

    # association
    iou_min: float = 0.3  # pairs with a smaller intersection over union are refused; SORT
    # Two rounds by score, as in ByteTrack (Zhang et al., 2022): detections of at least this score
    # choose first; the others may only continue a person who was matched in the frame before.
    # 0: one round, SORT.
    score_high: float = 0.0
    # life cycle
    score_new: float = 0.0  # detections of a smaller score begin no track; 0: SORT
    min_hits: int = 3  # matches in a row after the first sight that confirm; SORT
    # "streak": after each miss a track has to be confirmed anew before it is told again, but in the
    # first min_hits frames all are told, SORT; "once": confirmed once is confirmed for good
    confirm: Literal["streak", "once"] = "streak"
    survival: Literal["fixed", "dynamic"] = "fixed"  # of an unmatched track; section 7
    t_lost: float = 1.0  # [frames] T_lost, unmatched frames that a track survives; section 7
    r: float = 5.0  # R, frames tracked that earn one frame more, if dynamic; section 7
    max_age: float = 30.0  # [frames] survived at most, if dynamic; section 7
    lost_max_s: float = 5.0  # [s] without a match after which any track ends; this project's
    # ego motion
    # Whether turns of the camera are corrected; section 7. "odometry": as odometry and transforms
    # tell them
    ego_motion: Literal["none", "odometry"] = "none"
    fov_deg: float | None = None  # [deg] horizontal field of view; absent: by the calibration
    # "linear": all columns move alike, section 7; "pinhole": by the place in the image, as a
    # camera without distortion sees them move; this project's
    projection: Literal["linear", "pinhole"] = "linear"
    # time
    # [Hz] frames a second; the step is then measured from the stamps. 0: each frame is one step,
    # however long it took, SORT
    rate_hz: float = 0.0

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            ValueError: A value is out of range.
        """
        for name in ("score_high", "score_new", "iou_min"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name}: expected 0 to 1, got {getattr(self, name)}")
        if self.iou_min == 0:
            raise ValueError("iou_min: expected > 0, got 0")
        for name in ("min_hits", "t_lost", "rate_hz"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(
                    f"{name}: expected a finite number >= 0, got {getattr(self, name)}"
                )
        for name in ("r", "max_age", "lost_max_s"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected > 0, got {getattr(self, name)}")
        if self.fov_deg is not None and not 0 < self.fov_deg < 180:
            raise ValueError(f"fov_deg: expected above 0, below 180, got {self.fov_deg}")
