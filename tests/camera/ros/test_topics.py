"""Finding colour, depth and calibration among the topics of a bag."""

import pytest

from people4d.errors import SourceError
from services.camera.ros.topics import CAMERA_INFO, COMPRESSED, IMAGE, ODOMETRY, Topics, find_topics

NONE = Topics("", "", "", "", "")

REALSENSE = {
    "/camera/color/image_raw": IMAGE,
    "/camera/color/image_raw/compressed": COMPRESSED,
    "/camera/color/camera_info": CAMERA_INFO,
    "/camera/depth/image_rect_raw": IMAGE,
    "/camera/depth/camera_info": CAMERA_INFO,
    "/camera/aligned_depth_to_color/image_raw": IMAGE,
    "/camera/aligned_depth_to_color/camera_info": CAMERA_INFO,
    "/camera/infra1/image_rect_raw": IMAGE,
    "/camera/imu": "sensor_msgs/msg/Imu",
    "/odom": ODOMETRY,
}


def test_realsense_prefers_raw_and_aligned() -> None:
    assert find_topics(REALSENSE, NONE) == Topics(
        "/camera/color/image_raw",
        "/camera/aligned_depth_to_color/image_raw",
        "/camera/color/camera_info",
        "/camera/aligned_depth_to_color/camera_info",
        "/odom",
    )


def test_compressed_bag() -> None:
    types = {
        "/xtion/rgb/image_raw/compressed": COMPRESSED,
        "/xtion/rgb/camera_info": CAMERA_INFO,
        "/xtion/depth_registered/image_raw/compressedDepth": COMPRESSED,
        "/xtion/depth_registered/image_raw/compressed": COMPRESSED,
    }
    topics = find_topics(types, NONE)
    assert topics.colour == "/xtion/rgb/image_raw/compressed"
    assert topics.depth == "/xtion/depth_registered/image_raw/compressedDepth"
    assert topics.colour_info == "/xtion/rgb/camera_info"


def test_two_cameras_are_ambiguous() -> None:
    types = {f"/{side}/{kind}/image_raw": IMAGE for side in "ab" for kind in ("color", "depth")}
    with pytest.raises(SourceError, match=r"several.*depth: /a/depth.*, /b/depth.*options.depth"):
        find_topics(types, NONE)
    wanted = Topics("/b/color/image_raw", "/b/depth/image_raw", "", "", "")
    assert find_topics(types, wanted) == wanted


def test_missing_topic_is_refused_with_the_list_of_topics() -> None:
    with pytest.raises(SourceError, match=r"no topic /x. It has /odom \(nav_msgs/Odometry\)"):
        find_topics({"/odom": ODOMETRY}, Topics("/x", "", "", "", ""))


def test_the_only_calibration_serves_colour_wherever_it_is() -> None:
    types = {"/rgb/image": IMAGE, "/depth/image": IMAGE, "/driver/camera_info": CAMERA_INFO}
    topics = find_topics(types, NONE)
    assert (topics.colour_info, topics.depth_info) == ("/driver/camera_info", "")


def test_best_name_of_a_driver_is_chosen_among_its_own() -> None:
    node = "/zed/zed_node"
    names = ("left/image_rect_color", "right/image_rect_color", "rgb/image_rect_color")
    types = {f"{node}/{name}": IMAGE for name in (*names, "depth/depth_registered")}
    types |= {f"{node}/{name}/compressed": COMPRESSED for name in names}
    topics = find_topics(types, NONE)
    assert topics.colour == f"{node}/rgb/image_rect_color"
    # The CameraInfo of another camera is not used.
    with pytest.raises(SourceError, match=r"several.*colour: /front/image_color"):
        find_topics(types | {"/front/image_color": IMAGE}, NONE)
