"""Topics of a camera, published right or wrong, and the source that receives them."""

import itertools
import os
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from common.ros2 import types
from common.ros2.config import Ros2Config
from common.ros2.names import TopicType
from common.ros2.transport import DEFAULT, LATCHED, Ros2Publisher
from common.ros2.transports import open_transport
from services.camera.ros.live import LiveRosOptions, LiveRosSource
from services.camera.source import SourceFrame, SourceItem
from tests.camera.ros.bags import FRAME, SIZE, Ros
from tests.network import Network

ROS = Ros(2)
DOMAIN = 1 + os.getpid() % 90
SECOND, STEP_NS = 10**9, 33_333_333
DEPTH_FRAME = "camera_depth_optical_frame"


def colour_pixels(size: tuple[int, int] = SIZE) -> Any:
    return np.arange(size[0] * size[1] * 3, dtype=np.uint8).reshape(*size, 3)


def depth_pixels(size: tuple[int, int] = SIZE) -> Any:
    return (500 + np.arange(size[0] * size[1], dtype=np.uint16)).reshape(size)


def ros2_config(transport: Any, network: Network) -> Ros2Config:
    domain = DOMAIN if transport == "dds" else 0
    return Ros2Config(transport=transport, endpoints=(network.endpoint,), domain_id=domain)


def open_live(transport: str, namespace: str, network: Network, **options: Any) -> LiveRosSource:
    config = ros2_config(transport, network)
    given = LiveRosOptions(ros2=config, **{"timeout_s": 0.5} | options)
    return LiveRosSource(f"ros2+{transport}:{namespace}", given)


class Driver:
    """Publishes messages by a transport of ours; tests/common/ros2 compares these with others'."""

    def __init__(self, config: Ros2Config) -> None:
        self.name = config.transport
        self._transport = open_transport(config)
        self._publishers: dict[str, Ros2Publisher] = {}

    def publish(self, topic: str, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self._publishers:
            qos = LATCHED if topic == "/tf_static" else DEFAULT
            self._publishers[topic] = self._transport.publisher(topic, kind, qos)
        self._publishers[topic].send(bytes(types.typestore().serialize_cdr(message, kind)))

    def close(self) -> None:
        self._transport.close()


@contextmanager
def repeated(publish: Callable[[int], object]) -> Iterator[None]:
    """Publish repeatedly, with the number of the round, until the end."""
    ended = threading.Event()

    def work() -> None:
        for number in itertools.count(1):
            publish(number)
            if ended.wait(0.03):
                return

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def until(items: Iterator[SourceItem], wanted: Callable[[SourceItem], bool]) -> list[SourceItem]:
    """Return the items up to the first wanted one."""
    found: list[SourceItem] = []
    for item in items:
        found.append(item)
        if wanted(item):
            return found
    raise AssertionError("the source ended")


def is_frame(item: SourceItem) -> bool:
    return isinstance(item, SourceFrame)


def info(frame: str = FRAME, size: tuple[int, int] = SIZE, fx: float = 10.0) -> Any:
    message = ROS.camera_info(fx=fx, frame=frame)
    message.height, message.width = size
    return message


def static(parent: str, child: str, x_m: float = 0.0) -> Any:
    fields = {
        "transforms": [
            {
                "header": {"frame_id": parent},
                "child_frame_id": child,
                "transform": {"translation": {"x": x_m}},
            }
        ]
    }
    return types.make("tf2_msgs/msg/TFMessage", fields)


class Raw:
    """Publishes bytes as rmw_zenoh would, right or wrong."""

    def __init__(self, session: Any, namespace: str) -> None:
        self._session = session
        self.namespace = namespace

    def put(self, name: str, message: Any, cdr: bytes = b"", **wrong: Any) -> None:
        """Publish a message below the namespace, or above it with a slash in front."""
        kind = message.__msgtype__
        topic = name if name.startswith("/") else f"{self.namespace}/{name}"
        key = TopicType(topic, kind, wrong.get("hash", types.type_hash(kind))).key(0)
        attachment = wrong.get("attachment", struct.pack("<qqB16s", 1, 1, 16, b"x" * 16))
        data = cdr or bytes(types.typestore().serialize_cdr(message, kind))
        self._session.put(key, data, attachment=attachment)

    def camera(self, number: int, size: tuple[int, int] = SIZE, depth: Any = None) -> None:
        """Publish calibration and a pair of images."""
        stamp_ns = SECOND + number * STEP_NS
        self.put("color/camera_info", info(size=size))
        self.put("color/image_raw", ROS.image(colour_pixels(size), "rgb8", stamp_ns))
        pixels = depth_pixels(size) if depth is None else depth
        self.put("depth/image_raw", ROS.image(pixels, "16UC1", stamp_ns))
