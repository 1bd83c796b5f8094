"""Live topics of a camera in ROS 2 that are absent, damaged or changing."""

import itertools
import threading
import time

import pytest

from common.ros2.transforms import stamp_of
from people4d.errors import ConfigError
from services.camera.config import CameraConfig
from services.camera.node import CameraNode
from services.camera.source import SourceFrame, SourceItem, SourceSetup
from services.camera.sources import kind_of, open_source
from tests.camera.ros.bags import SIZE
from tests.camera.ros.live_topics import (
    ROS,
    SECOND,
    STEP_NS,
    Raw,
    colour_pixels,
    depth_pixels,
    info,
    is_frame,
    open_live,
    repeated,
    static,
    until,
)
from tests.network import WAIT_S, Network

pytestmark = [pytest.mark.network, pytest.mark.slow]


def test_bad_messages_are_counted_and_frames_go_on(
    network: Network, namespace: str, raw: Raw
) -> None:
    source = open_live("zenoh", namespace, network)
    image = ROS.image(colour_pixels(), "rgb8", SECOND)
    strange = ROS.image(colour_pixels(), "bayer_rggb8", 0)

    def publish(number: int) -> None:
        raw.put("color/image_raw", image, cdr=b"\0\1\0\0junk")
        raw.put("color/image_raw", image, hash=f"RIHS01_{'0' * 64}")
        raw.put("color/image_raw", image, attachment=None)
        raw.put("color/image_raw", image, attachment=b"short")
        strange.header = ROS.header(SECOND + number * STEP_NS + STEP_NS // 2)
        raw.put("color/image_raw", strange)
        raw.put("depth/image_raw", ROS.image(depth_pixels(), "16UC1", stamp_of(strange)))
        for parent, child in (("a", "b"), ("b", "c"), ("c", "a"), ("", "d")):
            raw.put("/tf", static(parent, child))
        raw.camera(number)

    wanted = (
        *("bad_message", "other_type", "no_attachment", "bad_images", "tf_loops"),
        *("bad_transforms", "unlinked_frames"),
    )
    with repeated(publish):
        items = iter(source)
        until(items, is_frame)
        until(items, lambda item: is_frame(item) and all(source.counters[n] for n in wanted))
    source.interrupt()
    assert {name: source.counters[name] > 0 for name in wanted} == dict.fromkeys(wanted, True)


@pytest.mark.parametrize("simulated", [True, False])
def test_stamp_of_0_is_a_time_of_a_simulation_or_none(
    network: Network, namespace: str, raw: Raw, simulated: bool
) -> None:
    source = open_live("zenoh", namespace, network, tf_topics=())

    def publish(number: int) -> None:
        stamp_ns = (number - 1) * STEP_NS * simulated
        raw.put("color/camera_info", info())
        raw.put("color/image_raw", ROS.image(colour_pixels(), "rgb8", stamp_ns))
        raw.put("depth/image_raw", ROS.image(depth_pixels(), "16UC1", stamp_ns))

    with repeated(publish):
        items = iter(source)
        frames = [item for _ in range(3) for item in until(items, is_frame)]
    source.interrupt()
    stamps = [item.stamp_ns for item in frames if isinstance(item, SourceFrame)]
    # Without a simulation: the time of sending, which is 1 ns here.
    assert all(0 < stamp_ns < 3600 * SECOND if simulated else stamp_ns == 1 for stamp_ns in stamps)


def test_change_of_size_is_followed_and_sizes_that_differ_are_counted(
    network: Network, namespace: str, raw: Raw
) -> None:
    source = open_live("zenoh", namespace, network, tf_topics=())
    large, received = (2 * SIZE[0], 2 * SIZE[1]), threading.Event()

    def publish(number: int) -> None:
        if not received.is_set():
            raw.camera(number)
        elif not source.counters["uncalibrated"]:
            raw.camera(number, depth=depth_pixels(large))
        else:
            raw.camera(number, large)

    def is_large(item: SourceItem) -> bool:
        if not isinstance(item, SourceFrame):
            return False
        received.set()
        return item.rgb.shape[:2] == large

    with repeated(publish):
        found = until(iter(source), is_large)
    source.interrupt()
    sizes = [item.info.height for item in found if isinstance(item, SourceSetup)]
    assert sizes == [SIZE[0], large[0]]
    assert source.counters["uncalibrated"]


def test_absent_topics_are_reported_and_nothing_hangs(network: Network, namespace: str) -> None:
    options = {"ros2": {"endpoints": [network.endpoint]}, "timeout_s": 0.2}
    config = CameraConfig(source=f"ros2:{namespace}", options=options)
    node = CameraNode(config, open_source(config.source, options=config.options))
    assert node.tick(0) == []
    deadline = time.monotonic() + WAIT_S
    while node.status().state != "degraded" or "no messages on" not in node.status().reason:
        assert time.monotonic() < deadline, node.status()
        node.tick(time.monotonic_ns())
        time.sleep(0.01)
    assert f"{namespace}/color/image_raw" in node.status().reason
    assert "more topics" in node.status().reason
    start_s = time.monotonic()
    node.close()
    assert time.monotonic() - start_s < 1.9


def test_missing_calibration_is_the_reason(network: Network, namespace: str, raw: Raw) -> None:
    source = open_live("zenoh", namespace, network, tf_topics=())
    stamps = itertools.count(1)

    def publish(_: int) -> None:
        stamp_ns = next(stamps) * SECOND
        raw.put("color/image_raw", ROS.image(colour_pixels(), "rgb8", stamp_ns))
        raw.put("depth/image_raw", ROS.image(depth_pixels(), "16UC1", stamp_ns))

    items = iter(source)
    with repeated(publish):
        reading = threading.Thread(target=lambda: next(items, None), daemon=True)
        reading.start()
        deadline = time.monotonic() + WAIT_S
        while "CameraInfo" not in source.problem:
            assert time.monotonic() < deadline, source.problem
            reading.join(0.02)
    source.interrupt()
    reading.join(WAIT_S)
    assert source.counters["uncalibrated"]


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        ("ros2:camera", "names no camera"),
        ("ros2+tcp:/camera", "unknown transport"),
        ("ros2:", "names no camera"),
    ],
)
def test_wrong_source_is_refused(source: str, problem: str) -> None:
    assert kind_of(source) == "ros2"
    with pytest.raises(ConfigError, match=problem):
        open_source(source)
