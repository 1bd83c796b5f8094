"""Names of the topics of cameras' ROS 2 drivers, and the choice of those that are there."""

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from people4d.errors import ConfigError
from services.camera.ros.topics import TRANSPORTS

SOURCE = re.compile(r"ros2(\+(?P<transport>\w+))?:(?P<name>.*)")
TRANSPORT_NAMES = ("zenoh", "dds")
RGBD_TOPIC = "rgbd"


@dataclass(frozen=True)
class Driver:
    """Topics of a driver, the better ones first."""

    namespace: str  # unless it is set
    colours: tuple[str, ...]  # images of colour, below the namespace
    depths: tuple[str, ...]  # images of depth; aligned ones first


DRIVERS = {
    "realsense": Driver(
        "/camera/camera",
        ("color/image_raw",),
        ("aligned_depth_to_color/image_raw", "depth/image_rect_raw"),
    ),
    "zed": Driver(
        "/zed/zed_node",
        ("rgb/color/rect/image", "rgb/image_rect_color"),
        ("depth/depth_registered",),
    ),
    "orbbec": Driver("/camera", ("color/image_raw",), ("depth/image_raw",)),
    "oak": Driver("/oak", ("rgb/image_rect", "rgb/image_raw"), ("stereo/image_raw",)),
}


@dataclass(frozen=True)
class Candidates:
    """Topics that may bring a camera's images, the better ones first."""

    transport: str  # name in `common.ros2.transports`
    colours: tuple[str, ...]
    depths: tuple[str, ...]

    def choose(self, delivering: Collection[str]) -> tuple[str, str] | None:
        """Return the best topics of colour and depth that deliver, None if one is lacking."""
        colour = next((topic for topic in self.colours if topic in delivering), None)
        depth = next((topic for topic in self.depths if topic in delivering), None)
        return (colour, depth) if colour and depth else None


def candidates(source: str, namespace: str, colour: str, depth: str) -> Candidates:
    """Return the topics that a source may mean.

    Args:
        source: `ros2:DRIVER` or `ros2:/NAMESPACE`, with +zenoh or +dds after ros2.
        namespace: Namespace of the driver; empty: its usual one.
        colour: Topic of colour; empty: any of the driver.
        depth: Topic of depth; empty: any of the driver.

    Raises:
        ConfigError: The transport or the driver is unknown.
    """
    match = SOURCE.fullmatch(source)
    name = match["name"] if match else ""
    transport = (match["transport"] if match else "") or "zenoh"
    if transport not in TRANSPORT_NAMES:
        raise ConfigError(
            f"source {source!r:.80} has an unknown transport",
            f"Write ros2: or ros2+ and one of {', '.join(TRANSPORT_NAMES)}.",
        )
    if name in DRIVERS:
        drivers, below = [DRIVERS[name]], namespace or DRIVERS[name].namespace
    elif name.startswith("/"):
        drivers, below = list(DRIVERS.values()), namespace or name
    else:
        raise ConfigError(
            f"source {source!r:.80} names no camera of ROS 2",
            f"Write ros2: and the camera's namespace (/camera), or {', '.join(DRIVERS)}.",
        )
    colours = (colour,) if colour else _topics(below, (d.colours for d in drivers), "/compressed")
    depths = (depth,) if depth else _topics(below, (d.depths for d in drivers), "/compressedDepth")
    return Candidates(transport, colours, (colour,) if _is_rgbd(colour) else depths)


def info_topic(image: str) -> str:
    """Return the topic of the CameraInfo beside an image."""
    for ending in TRANSPORTS[1:]:
        image = image.removesuffix(ending)
    return f"{image.rpartition('/')[0]}/camera_info"


def image_kind(topic: str) -> str:
    """Return the type of an image's topic, which drivers show in its name."""
    if _is_rgbd(topic):
        return "realsense2_camera_msgs/msg/RGBD"
    packed = topic.endswith(TRANSPORTS[1:])
    return f"sensor_msgs/msg/{'CompressedImage' if packed else 'Image'}"


def _is_rgbd(topic: str) -> bool:
    return topic.rpartition("/")[2] == RGBD_TOPIC


def _topics(namespace: str, names: Iterable[tuple[str, ...]], packed: str) -> tuple[str, ...]:
    """Return full names, each raw and compressed, none twice."""
    below = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
    unique = dict.fromkeys(name for group in names for name in group)
    raw = [f"{below}/{name}" for name in unique]
    return (*raw, *(f"{topic}{packed}" for topic in raw))
