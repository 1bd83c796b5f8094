"""Live topics of a camera in ROS 2."""

import time
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pytest

pytest.importorskip("cyclonedds")

from common.io.images import encode_jpeg, encode_png16
from common.ros2 import types
from people4d.messages import CameraInfo, MovingTransform, Odometry, RgbdFrame, StaticTransform
from services.camera.config import CameraConfig
from services.camera.folder.registration import Registration
from services.camera.node import CameraNode
from services.camera.ros.drivers import DRIVERS, candidates
from services.camera.ros.images import COMPRESSED_DEPTH_HEADER
from services.camera.ros.live import LiveRosOptions, LiveRosSource
from services.camera.source import SourceFrame, SourceItem, SourceSetup
from services.camera.sources import open_source
from tests.camera.ros.bags import FRAME, SIZE
from tests.camera.ros.live_topics import (
    DEPTH_FRAME,
    ROS,
    SECOND,
    STEP_NS,
    Driver,
    Raw,
    colour_pixels,
    depth_pixels,
    info,
    is_frame,
    open_live,
    repeated,
    ros2_config,
    static,
    until,
)
from tests.common.ros2.idl.peer import LOOPBACK
from tests.network import WAIT_S, Network

pytestmark = [pytest.mark.network, pytest.mark.slow]


@pytest.fixture(params=["zenoh", "dds"])
def opened(
    request: pytest.FixtureRequest,
    network: Network,
    namespace: str,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[tuple[LiveRosSource, Driver]]:
    """Source, and the driver that it receives."""
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    driver = Driver(ros2_config(request.param, network))
    source = open_live(request.param, namespace, network)
    yield source, driver
    source.interrupt()
    driver.close()


def test_frames_of_a_driver_arrive_as_the_same_arrays(
    opened: tuple[LiveRosSource, Driver], network: Network, namespace: str
) -> None:
    _, driver = opened
    source = open_live(driver.name, namespace, network, base_frame="base_link")
    start_ns = time.time_ns()
    driver.publish("/tf_static", static("base_link", FRAME, 0.25))

    def publish(number: int) -> None:
        stamp_ns = start_ns + number * STEP_NS
        driver.publish(f"{namespace}/color/camera_info", info())
        colour = ROS.image(colour_pixels(), "rgb8", stamp_ns)
        driver.publish(f"{namespace}/color/image_raw", colour)
        depth = ROS.image(depth_pixels(), "16UC1", stamp_ns + 2_000_000)
        driver.publish(f"{namespace}/aligned_depth_to_color/image_raw", depth)

    with repeated(publish):
        setup, *_, frame = until(iter(source), is_frame)
    assert isinstance(setup, SourceSetup)
    assert isinstance(frame, SourceFrame)
    np.testing.assert_array_equal(frame.rgb, colour_pixels())
    np.testing.assert_array_equal(frame.depth_mm, depth_pixels())
    assert (frame.stamp_ns - start_ns) % STEP_NS == 0
    assert (setup.info.fx, setup.info.width, setup.info.frame_id) == (10.0, SIZE[1], FRAME)
    (mount,) = setup.transforms
    assert (mount.parent, mount.child, mount.matrix[0, 3]) == ("base_link", FRAME, 0.25)
    assert source.problem == ""


def test_depth_of_another_lens_is_registered_by_tf_and_calibration(
    opened: tuple[LiveRosSource, Driver], namespace: str
) -> None:
    source, driver = opened
    size = (12, 16)
    driver.publish("/tf_static", static(FRAME, DEPTH_FRAME, 0.05))

    def publish(number: int) -> None:
        stamp_ns = number * STEP_NS
        driver.publish(f"{namespace}/color/camera_info", info())
        driver.publish(f"{namespace}/depth/camera_info", info(DEPTH_FRAME, size, fx=20.0))
        driver.publish(f"{namespace}/color/image_raw", ROS.image(colour_pixels(), "rgb8", stamp_ns))
        depth = ROS.image(depth_pixels(size), "16UC1", stamp_ns, frame=DEPTH_FRAME)
        driver.publish(f"{namespace}/depth/image_rect_raw", depth)

    with repeated(publish):
        setup, *_, frame = until(iter(source), is_frame)
    assert isinstance(setup, SourceSetup)
    assert isinstance(frame, SourceFrame)
    lens = msgspec.structs.replace(setup.info, fx=20.0, fy=20.0, width=16, height=12)
    matrix = np.eye(4)
    matrix[0, 3] = 0.05
    expected = Registration(lens, setup.info, matrix)(depth_pixels(size))
    assert expected.any()
    np.testing.assert_array_equal(frame.depth_mm, expected)


def test_odometry_and_moving_transforms_follow(
    opened: tuple[LiveRosSource, Driver], network: Network, namespace: str
) -> None:
    _, driver = opened
    odom = f"{namespace}/odom"
    source = open_live(driver.name, namespace, network, odometry_topic=odom)
    driver.publish("/tf_static", static("pan_link", FRAME))

    def publish(number: int) -> None:
        stamp_ns = SECOND + number * STEP_NS
        head = ROS.header(stamp_ns, "odom")
        moving = static("base_link", "pan_link", 0.1)
        moving.transforms[0].header = ROS.header(stamp_ns, "base_link")
        driver.publish("/tf", moving)
        odometry = types.make("nav_msgs/msg/Odometry", {"child_frame_id": "base_link"})
        odometry.header, odometry.pose.pose.position.x = head, float(number)
        driver.publish(odom, odometry)
        driver.publish(f"{namespace}/color/camera_info", info())
        driver.publish(f"{namespace}/color/image_raw", ROS.image(colour_pixels(), "rgb8", stamp_ns))
        driver.publish(f"{namespace}/depth/image_raw", ROS.image(depth_pixels(), "16UC1", stamp_ns))

    found: list[SourceItem] = []
    with repeated(publish):
        for item in source:
            found.append(item)
            kinds = {type(one) for one in found}
            if {SourceFrame, Odometry, MovingTransform} <= kinds:
                break
    source.interrupt()
    moved = next(item for item in found if isinstance(item, MovingTransform))
    assert (moved.parent, moved.child, moved.matrix[0, 3]) == ("base_link", "pan_link", 0.1)
    odometry = next(item for item in found if isinstance(item, Odometry))
    assert (odometry.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert odometry.stamp_ns == SECOND + round(odometry.x_m) * STEP_NS
    setup = next(item for item in reversed(found) if isinstance(item, SourceSetup))
    assert [(t.parent, t.child) for t in setup.transforms] == [("pan_link", FRAME)]
    assert setup.moves


def test_camera_node_publishes_calibration_before_the_first_frame(
    network: Network, namespace: str, raw: Raw
) -> None:
    options = {"ros2": {"endpoints": [network.endpoint]}, "tf_topics": []}
    config = CameraConfig(source=f"ros2:{namespace}", options=options, start_delay_s=0)
    node = CameraNode(config, open_source(config.source, options=config.options))
    sent: list[Any] = []
    deadline = time.monotonic() + WAIT_S
    with repeated(raw.camera):
        while not any(isinstance(message, RgbdFrame) for message in sent):
            assert time.monotonic() < deadline, node.status()
            sent += node.tick(time.monotonic_ns())
            time.sleep(0.002)
    assert [type(message) for message in sent[:3]] == [CameraInfo, StaticTransform, RgbdFrame]
    assert sent[1].parent == "map"  # the mount of the settings: no transform arrived
    assert node.status().state == "ready"
    node.close()


def test_compressed_images_arrive(network: Network, namespace: str, raw: Raw) -> None:
    source = open_live("zenoh", namespace, network, tf_topics=())
    colour = np.full((*SIZE, 3), 90, np.uint8)
    layouts = ("rgb8; jpeg compressed bgr8", "16UC1; compressedDepth png")
    packed = (
        encode_jpeg(colour, 95),
        COMPRESSED_DEPTH_HEADER.pack(0, 0, 0) + encode_png16(depth_pixels()),
    )

    def publish(number: int) -> None:
        raw.put("color/camera_info", info())
        names = ("color/image_raw/compressed", "depth/image_raw/compressedDepth")
        for name, layout, data in zip(names, layouts, packed, strict=True):
            raw.put(name, ROS.compressed(data, layout, SECOND + number * STEP_NS))

    with repeated(publish):
        *_, frame = until(iter(source), is_frame)
    source.interrupt()
    assert isinstance(frame, SourceFrame)
    np.testing.assert_allclose(frame.rgb, colour, atol=3)
    np.testing.assert_array_equal(frame.depth_mm, depth_pixels())


def test_rgbd_messages_and_wheels_arrive(network: Network, namespace: str, raw: Raw) -> None:
    rgbd, joints = f"{namespace}/rgbd", f"{namespace}/joint_states"
    options = {"colour_topic": rgbd, "wheel_topics": (joints,), "tf_topics": ()}
    source = open_live("zenoh", namespace, network, **options)
    names = list(LiveRosOptions().wheels.joints)

    def publish(number: int) -> None:
        stamp_ns = SECOND + number * STEP_NS
        message = types.make("realsense2_camera_msgs/msg/RGBD", {})
        message.header = ROS.header(stamp_ns)
        message.rgb = ROS.image(colour_pixels(), "rgb8", stamp_ns)
        message.depth = ROS.image(depth_pixels(), "16UC1", stamp_ns)
        message.rgb_camera_info = message.depth_camera_info = info()
        raw.put("rgbd", message)
        wheels = types.make("sensor_msgs/msg/JointState", {"name": names})
        wheels.header, wheels.position = ROS.header(stamp_ns), np.full(2, 0.1 * number)
        raw.put("joint_states", wheels)

    found: list[SourceItem] = []
    with repeated(publish):
        for item in source:
            found.append(item)
            if {SourceFrame, Odometry} <= {type(one) for one in found}:
                break
    source.interrupt()
    frame = next(item for item in found if isinstance(item, SourceFrame))
    np.testing.assert_array_equal(frame.rgb, colour_pixels())
    np.testing.assert_array_equal(frame.depth_mm, depth_pixels())


def test_driver_names_the_topics_and_better_ones_are_chosen() -> None:
    found = candidates("ros2+dds:realsense", "", "", "")
    assert found.transport == "dds"
    below = "/camera/camera"
    assert found.colours == (f"{below}/color/image_raw", f"{below}/color/image_raw/compressed")
    aligned, raw = f"{below}/aligned_depth_to_color/image_raw", f"{below}/depth/image_rect_raw"
    assert found.depths[:2] == (aligned, raw)
    assert found.choose([raw, *found.colours]) == (found.colours[0], raw)
    assert found.choose([raw, aligned, found.colours[1]]) == (found.colours[1], aligned)
    assert found.choose([raw, aligned]) is None
    assert candidates("ros2:oak", "/robot1/oak", "", "").depths[0] == "/robot1/oak/stereo/image_raw"
    assert set(DRIVERS) == {"realsense", "zed", "orbbec", "oak"}
