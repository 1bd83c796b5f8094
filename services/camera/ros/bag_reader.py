"""Bags of RGB-D cameras: the types of ROS and that of a RealSense driver."""

from contextlib import AbstractContextManager
from pathlib import Path

from rosbags.typesys.store import Typestore

from common.io import ros_bag
from common.io.ros_bag import Bag

RGBD = "realsense2_camera_msgs/msg/RGBD"
RGBD_DEFINITION = """
std_msgs/Header header
sensor_msgs/CameraInfo rgb_camera_info
sensor_msgs/CameraInfo depth_camera_info
sensor_msgs/Image rgb
sensor_msgs/Image depth
"""
# Not among the types of ROS 1 that rosbags brings; the latter is the older name.
TRANSFORMS, OLD_TRANSFORMS = "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"
TRANSFORMS_DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"
DEFINITIONS = {
    RGBD: RGBD_DEFINITION,
    TRANSFORMS: TRANSFORMS_DEFINITION,
    OLD_TRANSFORMS: TRANSFORMS_DEFINITION,
}


def ros1_types() -> Typestore:
    """Return the types of ROS 1 with those of transforms."""
    return ros_bag.make_typestore(1, DEFINITIONS)


def ros2_types() -> Typestore:
    """Return the types of ROS 2 with realsense2_camera_msgs/RGBD."""
    return ros_bag.make_typestore(2, DEFINITIONS)


def open_bag(path: Path) -> AbstractContextManager[Bag]:
    """Open a .bag, .db3 or .mcap file or the folder of a ROS 2 bag.

    Raises:
        SourceError: The bag is absent, cut short, damaged, or would cost more than a bag does.
    """
    return ros_bag.open_bag(path, DEFINITIONS)
