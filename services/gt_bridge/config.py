"""Configuration of the ground-truth bridge."""

from typing import Annotated, Literal

from msgspec import Meta

from common.config import Config
from common.geometry.transforms import rotation_from_rpy, transform_from
from common.ros2.config import Ros2Config
from people4d.messages import StaticTransform
from people4d.messages.base import Name, NonNegative, Positive


class FixedTransform(Config, frozen=True, kw_only=True):
    """Pose of one frame in another, as calibrated."""

    parent: Name  # frame that holds the other, for example "map"
    child: Name  # the other frame, for example "mocap"
    xyz_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] origin of child in parent
    rpy_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [rad] about parent's fixed x, y, z

    def message(self) -> StaticTransform:
        """Return it as the camera would publish it."""
        matrix = transform_from(self.xyz_m, rotation_from_rpy(*self.rpy_rad))
        return StaticTransform(
            stamp_ns=0, sequence=0, parent=self.parent, child=self.child, matrix=matrix
        )


class GtBridgeConfig(Config, frozen=True, kw_only=True):
    """Source and playback of the truth, and how tracks are scored against it."""

    # recording, ROS bag, CSV, MOT text, gt.npz or its folder; live: ros2:/TOPIC or ros2+dds:/TOPIC
    # of people_msgs/People or PoseStamped, zenoh:KEY of people_msgs/People; empty: none
    truth: str = ""
    # kind of truth: auto, recording, rosbag, npz, csv, mot, live, ros2, or module:Class of your own
    source: str = "auto"
    topic: str = ""  # ROS topic of people_msgs/People; empty: the only one in the bag
    ros2: Ros2Config = Ros2Config(node="people4d_truth")  # of ros2:, its transport: as named there
    rate_hz: NonNegative = 0.0  # [Hz] of the frames of MOT text; 0: as seqinfo.ini beside it says
    # time
    playback: Literal["frames", "recorded"] = "frames"  # with the pipeline, or by its own clock
    offset_s: float = 0.0  # [s] added to stamps of the truth: from its clock to the camera's
    loop_s: NonNegative = 0.0  # [s] what a looping camera adds to its stamps each round; 0: no loop
    # frames
    truth_frame: str = ""  # frame that the truth is in; empty: as its source says, else map
    frame_id: str = "map"  # frame that it is published in
    transforms: tuple[FixedTransform, ...] = ()  # beside those that the camera publishes
    # score
    gate_m: Positive = 1.0  # [m] a track farther from the truth is not that person
    # [s] widest clock offset that is estimated from the tracks; 0: none
    align_clock_s: Annotated[float, Meta(ge=0, le=5)] = 0.0
    # rigid motion of the truth that is estimated: turn about z and shift, or any
    align_space: Literal["off", "2d", "3d"] = "off"
    apply_alignment: bool = False  # True: errors are those after the alignment that was estimated
