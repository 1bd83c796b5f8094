"""Topics of ROS 2 camera drivers, and the choice among available topics."""

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from people4d.errors import ConfigError

COMPRESSED_DEPTH = "/compressedDepth"
# Suffixes of topics by transport, the preferred ones first.
TRANSPORTS = ("", COMPRESSED_DEPTH, "/compressed")
SOURCE = re.compile(r"ros2(\+(?P<transport>\w+))?:(?P<name>.*)")
TRANSPORT_NAMES = ("zenoh", "dds")
RGBD_TOPIC = "rgbd"


@dataclass(frozen=True)
class Driver:
    """Topics of a driver, the preferred ones first."""

    namespace: str  # default namespace
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
    """Possible topics of a camera's images, the preferred ones first."""

    transport: str  # name in `common.ros2.transports`
    colours: tuple[str, ...]
    depths: tuple[str, ...]

    def choose(self, delivering: Collection[str]) -> tuple[str, str] | None:
        """Return the preferred delivering topics of colour and depth, None if one is lacking."""
        colour = next((topic for topic in self.colours if topic in delivering), None)
        depth = next((topic for topic in self.depths if topic in delivering), None)
        return (colour, depth) if colour and depth else None


def candidates(source: str, namespace: str, colour: str, depth: str) -> Candidates:
    """Return the possible topics of a source.

    ConfigError if the transport or the driver is unknown.

    Args:
        source: `ros2:DRIVER` or `ros2:/NAMESPACE`, with +zenoh or +dds after ros2.
        namespace: Namespace of the driver; empty: its usual one.
        colour: Topic of colour; empty: any of the driver.
        depth: Topic of depth; empty: any of the driver.
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
    depths = (depth,) if depth else _topics(below, (d.depths for d in drivers), COMPRESSED_DEPTH)
    return Candidates(transport, colours, (colour,) if _is_rgbd(colour) else depths)


def best_of_driver(topics: list[str]) -> list[str]:
    """Return the topics with a driver's preferred name if one driver publishes all, else all."""
    for name in (name for driver in DRIVERS.values() for name in driver.colours + driver.depths):
        named = [topic for topic in topics if stream_of(topic).endswith(f"/{name}")]
        below = {stream_of(topic).removesuffix(name) for topic in named}
        if len(below) == 1 and all(topic.startswith(tuple(below)) for topic in topics):
            return named
    return topics


def stream_of(topic: str) -> str:
    """Return the topic of a stream without the suffix of its transport."""
    for transport in TRANSPORTS[1:]:
        topic = topic.removesuffix(transport)
    return topic


def info_topic(image: str) -> str:
    """Return the topic of the CameraInfo of an image topic."""
    return f"{stream_of(image).rpartition('/')[0]}/camera_info"


def image_kind(topic: str) -> str:
    """Return the type of an image topic by its name."""
    if _is_rgbd(topic):
        return "realsense2_camera_msgs/msg/RGBD"
    packed = topic.endswith(TRANSPORTS[1:])
    return f"sensor_msgs/msg/{'CompressedImage' if packed else 'Image'}"


def _is_rgbd(topic: str) -> bool:
    return topic.rpartition("/")[2] == RGBD_TOPIC


def _topics(namespace: str, names: Iterable[tuple[str, ...]], packed: str) -> tuple[str, ...]:
    """Return full names, raw and compressed, without duplicates."""
    below = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
    unique = dict.fromkeys(name for group in names for name in group)
    raw = [f"{below}/{name}" for name in unique]
    return (*raw, *(f"{topic}{packed}" for topic in raw))
