"""Types of ROS messages that cameras use, and bags of them."""

from contextlib import AbstractContextManager
from pathlib import Path

from rosbags.typesys.store import Typestore

from common.io import ros_bag
from common.io.ros_bag import Bag

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
ODOMETRY = "nav_msgs/msg/Odometry"
JOINTS = "sensor_msgs/msg/JointState"
TF, OLD_TF = "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"  # the latter in old ROS 1
RGBD = "realsense2_camera_msgs/msg/RGBD"
TF_DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"
RGBD_DEFINITION = """
std_msgs/Header header
sensor_msgs/CameraInfo rgb_camera_info
sensor_msgs/CameraInfo depth_camera_info
sensor_msgs/Image rgb
sensor_msgs/Image depth
"""
# Types that rosbags lacks, some in ROS 1 only.
DEFINITIONS = {RGBD: RGBD_DEFINITION, TF: TF_DEFINITION, OLD_TF: TF_DEFINITION}


def ros2_types() -> Typestore:
    """Return the types of ROS 2 with realsense2_camera_msgs/RGBD."""
    return ros_bag.make_typestore(2, DEFINITIONS)


def open_bag(path: Path) -> AbstractContextManager[Bag]:
    """Open a bag, see `common.io.ros_bag.open_bag`, with the types that cameras use."""
    return ros_bag.open_bag(path, DEFINITIONS)
