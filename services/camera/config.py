"""Configuration of the camera service."""

from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from common.config import Config
from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from common.geometry.wheel_odometry import WheelConfig
from people4d.messages import F64
from people4d.messages.base import Count, Name, NameOrEmpty, NonNegative, Positive, PositiveInt
from people4d.topics import LOCKSTEP_MAX
from services.camera.upright import TURN


class MotionConfig(Config, frozen=True, kw_only=True):
    """Live ROS 2 topics with the robot's motion: "zenoh:" and the key of a topic in CDR."""

    odometry: str = ""  # nav_msgs/Odometry, for example zenoh:odom; empty: none
    joints: str = ""  # sensor_msgs/JointState with the wheels for odometry; empty: none
    wheels: WheelConfig = WheelConfig()  # geometry of the wheels of `joints`
    # tf2_msgs/TFMessage, for example ["zenoh:tf"]: transforms of a camera that pans or tilts
    transforms: tuple[str, ...] = ()
    offset_s: float = 0.0  # [s] added to stamps of motion: camera's clock minus robot's clock

    @property
    def enabled(self) -> bool:
        """True if at least one topic is configured."""
        return bool(self.odometry or self.joints or self.transforms)

    def __post_init__(self) -> None:
        """Check that odometry has one source."""
        super().__post_init__()
        if self.odometry and self.joints:
            raise ValueError("odometry, joints: expected one of them, got both")


class CameraConfig(Config, frozen=True, kw_only=True):
    """Source, mount and playback of a camera."""

    # Path of a recording, bag or folder, name of a camera, or module:Class of a plug-in camera
    source: str = ""
    options: dict[str, Any] = msgspec.field(default_factory=dict)  # options of the kind of source
    # name in keys and messages; empty: as in the recording, else "camera". Frames and processes are
    # named after it, so it has at most 50 characters
    camera: Annotated[NameOrEmpty, Meta(max_length=50)] = ""
    max_depth_m: Positive | None = None  # [m] maximum valid depth; absent: of the source, else 5
    mount_xyz_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] camera_link in mount_parent
    mount_rpy_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [rad] about fixed x, y, z
    # [deg] clockwise rotation to upright images, then mount_* is the pose of the upright camera;
    # absent: by the roll of the pose
    rotate: Literal[0, 90, 180, 270] | None = None
    # File of people4d calibrate; its pose replaces the pose from the source and mount_*
    transforms: str = ""
    mount_parent: Name = "map"  # frame of the mount; used if the source has no transform
    motion: MotionConfig = MotionConfig()  # live motion of the robot, in addition to the source
    playback: Literal["auto", "recorded", "lockstep", "live"] = "auto"  # auto: recorded, or live
    speed: Positive = 1.0  # speed of recorded playback, 2 = twice as fast
    # Maximum number of unanswered frames in lockstep
    window: Annotated[int, Meta(ge=1, le=LOCKSTEP_MAX)] = 2
    answer: Literal["people", "detections"] = "people"  # topic whose stamp answers a frame
    # [s] maximum wait for an answer, after which playback continues
    answer_timeout_s: Positive = 5.0
    loop: bool = False  # True: playback repeats from the start; stamps keep rising
    start_s: NonNegative = 0.0  # [s] start in the recording
    duration_s: NonNegative = 0.0  # [s] played duration of the recording; 0: all
    max_frames: Count = 0  # maximum number of sent frames; 0: all
    stride: PositiveInt = 1  # n: only every n-th frame is sent
    # [Hz] maximum rate of compressed frames (JPEG and PNG), which may leave the host; 0: none
    compressed_hz: NonNegative = 0.0
    # [s] pause between calibration and first frame of a recording, for late subscribers
    start_delay_s: NonNegative = 0.5

    @property
    def mount_from_optical(self) -> F64:
        """The camera's pose in `mount_parent` (4x4), as configured."""
        rotation = rotation_from_rpy(*self.mount_rpy_rad)
        upright = transform_from(self.mount_xyz_m, rotation) @ LINK_FROM_OPTICAL
        pose: F64 = upright @ np.linalg.matrix_power(TURN, (self.rotate or 0) // 90)
        return pose
