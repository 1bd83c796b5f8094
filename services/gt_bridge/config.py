"""Configuration of the ground-truth bridge."""

from typing import Annotated, Literal

from msgspec import Meta

from common.config import Config
from common.geometry.transforms import rotation_from_rpy, transform_from
from common.ros2.config import Ros2Config
from people4d.messages import StaticTransform
from people4d.messages.base import Name, NonNegative, Positive


class FixedTransform(Config, frozen=True, kw_only=True):
    """Calibrated pose of a child frame in a parent frame."""

    parent: Name  # parent frame, for example "map"
    child: Name  # child frame, for example "mocap"
    xyz_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # origin of child in parent [m]
    # rotations about the fixed axes x, y and z of parent [rad]
    rpy_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def message(self) -> StaticTransform:
        """Return the transform as a message."""
        matrix = transform_from(self.xyz_m, rotation_from_rpy(*self.rpy_rad))
        return StaticTransform(
            stamp_ns=0, sequence=0, parent=self.parent, child=self.child, matrix=matrix
        )


class GtBridgeConfig(Config, frozen=True, kw_only=True):
    """Source and playback of the truth, and its comparison with tracks."""

    # recording, ROS bag, CSV, MOT text, gt.npz or its folder; live: ros2:/TOPIC or ros2+dds:/TOPIC
    # of people_msgs/People or PoseStamped; empty: no truth
    truth: str = ""
    # kind of truth: auto, recording, rosbag, npz, csv, mot, ros2, or module:Class of a plug-in
    source: str = "auto"
    topic: str = ""  # ROS topic of people_msgs/People; empty: the only one in the bag
    ros2: Ros2Config = Ros2Config(node="people4d_truth")  # connection of ros2:, except transport
    rate_hz: NonNegative = 0.0  # frame rate of MOT text; 0: from its seqinfo.ini [Hz]
    # time
    offset_s: float = 0.0  # clock of the camera less clock of the truth, added to stamps [s]
    loop_s: NonNegative = 0.0  # length of a round of a looping camera; 0: no loop [s]
    # frames
    truth_frame: str = ""  # frame of the truth; empty: as named by its source, else map
    frame_id: str = "map"  # frame of the published truth
    transforms: tuple[
        FixedTransform, ...
    ] = ()  # calibrated transforms, in addition to published ones
    # score
    gate_m: Positive = 1.0  # maximum distance of a match between track and truth [m]
    # maximum clock offset of the estimated alignment; 0: not estimated [s]
    align_clock_s: Annotated[float, Meta(ge=0, le=5)] = 0.0
    # estimated rigid motion of the truth: 2d (rotation about z and shift), or 3d (any)
    align_space: Literal["off", "2d", "3d"] = "off"
    apply_alignment: bool = False  # True: the estimated alignment is applied before scoring
