"""Configuration of the tracker service.

Presets hold the published constants. Sections are sections of docs/method.md; values without a
source are set by this project.
"""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from common.config import Config
from people4d.messages.base import (
    NonNegative,
    Positive,
    PositiveInt,
    PositiveOrInfinite,
)
from services.tracker.areas.config import SiteAreaConfig
from services.tracker.strongsort3d.config import StrongSort3dConfig


class Sort3dConfig(Config, frozen=True, kw_only=True):
    """SORT-3D [PIC4SeR], section 4; its other constants are in `sort3d`."""

    # [m] minimum distance gate tau. With one person sigma is 0 and tau is the last distance, which
    # rejects about every second match; 0: the published rule
    distance_gate_floor_m: NonNegative = 0.5
    min_hits: PositiveInt = 3  # consecutive matches that confirm a track; section 4
    t_lost: PositiveInt = 30  # [frames] unmatched frames that end a track; SORT: 1 (section 7)


class ImageSortConfig(Config, frozen=True, kw_only=True):
    """SORT [Bewley 2016] with the two settings of [Park 2021] (section 7).

    The constants of the Kalman filter are SORT's and are in `box_kalman`.
    """

    min_hits: Annotated[int, Meta(ge=0)] = 3  # consecutive matches that confirm; SORT
    lifetime: Literal["fixed", "dynamic"] = "fixed"  # lifetime of an unmatched track; section 7
    t_lost: NonNegative = 1.0  # [frames] T_lost: longest lifetime without a match; section 7
    r: PositiveOrInfinite = 5.0  # R: tracked frames per additional frame, if dynamic; section 7
    max_age: PositiveOrInfinite = 30.0  # [frames] maximum dynamic lifetime; section 7
    # Correction of the camera's rotation; section 7. "odometry": by odometry and transforms
    ego_motion: Literal["none", "odometry"] = "none"
    # "linear": equal displacement of all columns, section 7; "pinhole": displacement by the
    # position in the image of a pinhole camera
    projection: Literal["linear", "pinhole"] = "linear"


class TrackerConfig(Config, frozen=True, kw_only=True):
    """Configuration of the tracker service."""

    # sort3d, strongsort3d, image_sort, or module:Class of a plug-in
    tracker: str = "strongsort3d"
    # Frame of the tracks: a fixed frame, or the robot's base ("base_link") without a map;
    # velocities are relative to the ground in both
    frame_id: str = "map"
    # True: frames of a camera without a transform are dropped. False: such a camera is at the
    # origin and looks along +x, and the status reports it
    require_transform: bool = False
    # output
    publish_lost: bool = True  # True: predicted unmatched tracks are published; section 4: False
    publish_tentative: bool = False  # True: unconfirmed tracks are published
    # "keypoints": measured yaws in a density filter (section 12); "kalman": in a Kalman filter
    # (section 6); "velocity": the direction of walking (section 4); "none"
    yaw: Literal["keypoints", "kalman", "velocity", "none"] = "keypoints"
    # [m/s] minimum speed for a yaw from velocity; section 4: 0
    yaw_speed_min_mps: NonNegative = 0.2
    # time
    max_lost_s: Positive = 5.0  # [s] maximum time without a match of any track
    embedding_wait_s: NonNegative = 0.05  # [s] maximum wait for the embeddings of a frame
    # [s] maximum wait for earlier frames of other cameras or detectors; absent: one frame interval
    # for detectors, no wait for cameras
    reorder_wait_s: NonNegative | None = None
    area: SiteAreaConfig = SiteAreaConfig()  # area of a site with several trackers
    # methods
    sort3d: Sort3dConfig = Sort3dConfig()  # SORT-3D; section 4
    strongsort3d: StrongSort3dConfig = StrongSort3dConfig()  # StrongSORT-3D; section 5
    image_sort: ImageSortConfig = ImageSortConfig()  # positions have the noise of strongsort3d
    options: dict[str, Any] = msgspec.field(default_factory=dict)  # options of a plug-in tracker
