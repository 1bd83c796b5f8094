"""Types of ROS that cameras use, bags of them, and the choice of topics in a bag."""

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import astuple, dataclass
from pathlib import Path

from common.io import ros_bag
from common.io.ros_bag import Bag
from people4d.errors import SourceError
from services.camera.ros.drivers import COMPRESSED_DEPTH, TRANSPORTS, best_of_driver, stream_of
from services.camera.ros.images import DEPTHS

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
ODOMETRY = "nav_msgs/msg/Odometry"
JOINTS = "sensor_msgs/msg/JointState"
TF, OLD_TF = "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"  # "tf/msg/tfMessage": old ROS 1
TRANSFORM = "geometry_msgs/msg/Transform"
RGBD = "realsense2_camera_msgs/msg/RGBD"
TF_DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"
# Types that rosbags lacks, some only for ROS 1
DEFINITIONS = {TF: TF_DEFINITION, OLD_TF: TF_DEFINITION}

COLOUR_WORDS = ("color", "colour", "rgb")
ALIGNED_WORDS = ("aligned_depth", "depth_registered", "depth_to_color", "depth_to_rgb")
OTHERS = re.compile(r"infra|(^|[/_])ir([/_]|$)|confidence|mask|label|debug|thermal")
FUSED_WORDS = ("filtered",)  # words in names of fused odometry, for example from robot_localization
# Topics of librealsense's recordings: STREAM/image/data, STREAM/info/camera_info, and in
# STREAM/tf/0 the transform from the device's first stream to this one.
SDK_IMAGE, SDK_INFO, SDK_TF = "/image/data", "/info/camera_info", "/tf/0"


def open_bag(path: Path) -> AbstractContextManager[Bag]:
    """Open a bag, see `common.io.ros_bag.open_bag`, with the types that cameras use."""
    return ros_bag.open_bag(path, DEFINITIONS)


@dataclass(frozen=True)
class Topics:
    """Topics to play; empty for none."""

    colour: str  # colour images, or RGBD messages
    depth: str  # depth images; the same as colour for RGBD messages
    colour_info: str  # calibration of colour; may be empty; RGBD messages contain it
    depth_info: str  # calibration of depth; may be empty
    odometry: str  # odometry; may be empty


def sdk_stream(image: str) -> str:
    """Return the stream of an image topic of librealsense's recordings, empty for other topics."""
    return image.removesuffix(SDK_IMAGE) if image.endswith(SDK_IMAGE) else ""


def find_topics(
    types: Mapping[str, str], wanted: Topics, encodings: Callable[[], Mapping[str, str]] = dict
) -> Topics:
    """Choose the topics of a bag.

    SourceError if a topic is absent or ambiguous.

    Args:
        types: Type of each topic.
        wanted: Topics given by name.
        encodings: Returns the encoding of image topics, which identifies depth; if empty,
            the word "depth" in the topic does.
    """
    for name in astuple(wanted):
        if name and name not in types:
            raise SourceError(f"bag has no topic {name}", f"It has {_list(types)}.")
    odometry = wanted.odometry or _odometry(types)
    rgbd = [topic for topic, kind in types.items() if kind == RGBD]
    if rgbd and wanted.colour in ("", *rgbd) and not wanted.depth:
        topic = wanted.colour or _choose("RGBD", rgbd, types, "colour_topic")
        return Topics(topic, topic, "", "", odometry)
    colour, depth = wanted.colour, wanted.depth
    if not (colour and depth):
        depths, colours = _images(types, encodings())
        depth = depth or _choose("depth", depths, types, "depth_topic")
        colours = [topic for topic in colours if topic != depth]
        colour = colour or _choose("colour", colours, types, "colour_topic")
    infos = [t for t, kind in types.items() if kind == CAMERA_INFO]
    return Topics(
        colour,
        depth,
        wanted.colour_info or _info_of(colour, infos),
        wanted.depth_info or _info_of(depth, infos),
        odometry,
    )


def _images(types: Mapping[str, str], encodings: Mapping[str, str]) -> tuple[list[str], list[str]]:
    """Return the possible topics of depth, and of colour."""
    images = [t for t, kind in types.items() if kind in (IMAGE, COMPRESSED)]
    images = [t for t in images if not OTHERS.search(t.lower())]
    depths = [
        topic
        for topic in images
        if topic.endswith(COMPRESSED_DEPTH)
        or (encodings.get(topic) in DEPTHS if encodings.get(topic) else "depth" in topic.lower())
    ]
    colours = [topic for topic in images if topic not in depths]
    undoubted = [topic for topic in colours if "depth" not in topic.lower()]
    depths = _narrow(_narrow(depths, ("depth",)), ALIGNED_WORDS)
    colours = _narrow(undoubted or colours, COLOUR_WORDS)
    return best_of_driver(depths), best_of_driver(colours)


def _odometry(types: Mapping[str, str]) -> str:
    topics = [topic for topic, kind in types.items() if kind == ODOMETRY]
    topics = _narrow(topics, FUSED_WORDS) if len(topics) > 1 else topics
    return _choose("odometry", topics, types, "odometry_topic") if topics else ""


def _choose(what: str, topics: Sequence[str], types: Mapping[str, str], option: str) -> str:
    if not topics:
        raise SourceError(
            f"bag has no {what} images", f"It has {_list(types)}; set options.{option}."
        )
    streams = {stream_of(topic) for topic in topics}
    if len(streams) > 1:
        raise SourceError(
            f"bag has several topics that could be {what}: {', '.join(sorted(topics))}",
            f"Set options.{option} to one of them.",
        )
    return min(topics, key=lambda topic: TRANSPORTS.index(topic.removeprefix(stream_of(topic))))


def _narrow(topics: list[str], words: Sequence[str]) -> list[str]:
    """Return the topics with one of the words in their name, all if there are none."""
    named = [topic for topic in topics if any(word in topic.lower() for word in words)]
    return named or topics


def _info_of(image: str, infos: Sequence[str]) -> str:
    """Find the camera_info next to an image topic, or the only one of its namespace."""
    namespace = stream_of(image).rsplit("/", 1)[0]
    for beside in (f"{namespace}/camera_info", sdk_stream(image) + SDK_INFO):
        if beside in infos:
            return beside
    below = [topic for topic in infos if topic.startswith(f"{namespace}/")]
    return _only(below) or (infos[0] if len(infos) == 1 and "depth" not in image else "")


def _only(topics: Sequence[str]) -> str:
    return topics[0] if len(topics) == 1 else ""


def _list(types: Mapping[str, str]) -> str:
    listed = [f"{topic} ({kind.replace('/msg/', '/')})" for topic, kind in sorted(types.items())]
    return ", ".join(listed[:30]) or "no topics"
