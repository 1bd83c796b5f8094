"""Configuration of the camera service."""

import math
from typing import Any, Literal

import msgspec

from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from people4d.messages import F64
from people4d.messages.base import check_name
from people4d.topics import LOCKSTEP_MAX
from services.camera.ros.motion import JointConfig


class MotionConfig(msgspec.Struct, frozen=True, kw_only=True):
    """What the robot's ROS 2 tells now of its motion: zenoh: and the key of a topic in CDR."""

    odometry: str = ""  # nav_msgs/Odometry, for example zenoh:odom; empty: none
    joints: str = ""  # sensor_msgs/JointState whose wheels make odometry; empty: none
    wheels: JointConfig = JointConfig()  # of joints
    # tf2_msgs/TFMessage, for example ["zenoh:tf"]: what a camera hangs on that pans, tilts, swings
    transforms: tuple[str, ...] = ()
    offset_s: float = 0.0  # [s] added to their stamps: from the robot's clock to the camera's

    @property
    def used(self) -> bool:
        """Whether anything is read."""
        return bool(self.odometry or self.joints or self.transforms)

    def __post_init__(self) -> None:
        """Check that odometry has one source.

        Raises:
            ValueError: It has two, or the offset is no number.
        """
        if self.odometry and self.joints:
            raise ValueError("odometry, joints: expected one of them, got both")
        if not math.isfinite(self.offset_s):
            raise ValueError(f"offset_s: expected a finite number, got {self.offset_s}")


class CameraConfig(msgspec.Struct, frozen=True, kw_only=True):
    """What to play and how."""

    source: str = ""  # path of a recording, bag or folder, or module:Class of a plug-in camera
    kind: str = "auto"  # recording, rosbag, folder or plugin; auto: found from the path
    options: dict[str, Any] = msgspec.field(default_factory=dict)  # what the source takes
    camera: str = ""  # name in keys and messages; empty: the recording's, else "camera"
    max_depth_m: float | None = None  # [m] readings beyond are invalid; None: the source's, else 5
    mount_xyz_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] camera_link in mount_parent
    mount_rpy_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [rad] about fixed x, y, z
    mount_parent: str = "map"  # frame the mount is given in; used if the source knows no transform
    motion: MotionConfig = MotionConfig()  # of the robot, beside what the source tells
    playback: Literal["auto", "recorded", "lockstep", "live"] = "auto"  # auto: recorded, or live
    speed: float = 1.0  # of recorded playback, 2 = twice as fast
    window: int = 2  # frames that may be unanswered in lockstep, 8 at most
    answer: Literal["people", "detections"] = "people"  # topic whose stamp answers a frame
    answer_timeout_s: float = 5.0  # [s] until a frame is given up and playback goes on
    loop: bool = False  # begin anew at the end; stamps keep rising
    start_s: float = 0.0  # [s] of the recording to leave out at its beginning
    duration_s: float = 0.0  # [s] of the recording to play; 0: all
    max_frames: int = 0  # frames to send; 0: all
    stride: int = 1  # send every n-th frame
    # [Hz] at most so many frames are sent as JPEG and PNG, too, which may leave the host; 0: none
    compressed_hz: float = 0.0
    start_delay_s: float = 0.5  # [s] between calibration and the first frame, for late subscribers

    @property
    def mount_from_optical(self) -> F64:
        """The camera's place in `mount_parent` (4x4), as configured."""
        turned = rotation_from_rpy(*self.mount_rpy_rad)
        return transform_from(self.mount_xyz_m, turned) @ LINK_FROM_OPTICAL

    def __post_init__(self) -> None:
        """Check names and numbers.

        Raises:
            ValueError: A value is out of range.
        """
        if self.camera:
            check_name("camera", self.camera)
        check_name("mount_parent", self.mount_parent)
        if not all(map(math.isfinite, (*self.mount_xyz_m, *self.mount_rpy_rad))):
            raise ValueError("mount_xyz_m, mount_rpy_rad: expected finite numbers")
        if not 0 < self.speed < math.inf or self.answer_timeout_s <= 0:
            raise ValueError(
                f"speed, answer_timeout_s: expected > 0, got {self.speed}, {self.answer_timeout_s}"
            )
        if self.window > LOCKSTEP_MAX:
            raise ValueError(f"window: expected at most {LOCKSTEP_MAX}, got {self.window}")
        if self.window < 1 or self.stride < 1:
            raise ValueError(f"window, stride: expected >= 1, got {self.window}, {self.stride}")
        if min(self.start_s, self.duration_s, self.max_frames, self.start_delay_s) < 0:
            raise ValueError("start_s, duration_s, max_frames, start_delay_s: expected >= 0")
        if not 0 <= self.compressed_hz < math.inf:
            raise ValueError(f"compressed_hz: expected >= 0, got {self.compressed_hz}")
        if self.max_depth_m is not None and not 0 < self.max_depth_m < math.inf:
            raise ValueError(f"max_depth_m: expected > 0, got {self.max_depth_m}")
