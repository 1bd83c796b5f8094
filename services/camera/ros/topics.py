"""Types of ROS that cameras use, bags of them, and the choice of topics in a bag."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import astuple, dataclass
from pathlib import Path

from rosbags.typesys.store import Typestore

from common.io import ros_bag
from common.io.ros_bag import Bag
from people4d.errors import SourceError

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
ODOMETRY = "nav_msgs/msg/Odometry"
JOINTS = "sensor_msgs/msg/JointState"
TF, OLD_TF = "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"  # the latter in old ROS 1
RGBD = "realsense2_camera_msgs/msg/RGBD"
TF_DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"
# Types that rosbags lacks, some in ROS 1 only.
DEFINITIONS = {TF: TF_DEFINITION, OLD_TF: TF_DEFINITION}

# Transports append their name to the topic; the earlier here, the better for depth and colour.
TRANSPORTS = ("", "/compressedDepth", "/compressed")
COLOUR_WORDS = ("color", "colour", "rgb")
ALIGNED_WORDS = ("aligned_depth", "depth_registered", "depth_to_color", "depth_to_rgb")
OTHER_WORDS = ("infra", "/ir/", "confidence", "mask", "label", "debug")


def ros2_types() -> Typestore:
    """Return the types of ROS 2 with realsense2_camera_msgs/RGBD."""
    return ros_bag.make_typestore(2, DEFINITIONS)


def open_bag(path: Path) -> AbstractContextManager[Bag]:
    """Open a bag, see `common.io.ros_bag.open_bag`, with the types that cameras use."""
    return ros_bag.open_bag(path, DEFINITIONS)


@dataclass(frozen=True)
class Topics:
    """Topics to play; empty for none."""

    colour: str  # colour images, or RGBD messages
    depth: str  # depth images; the same as colour for RGBD messages
    colour_info: str  # calibration of colour; may be empty, and is for RGBD, which carries it
    depth_info: str  # calibration of depth; may be empty
    odometry: str  # odometry; may be empty


def find_topics(types: Mapping[str, str], wanted: Topics) -> Topics:
    """Choose topics that are not wanted by name; SourceError if one is absent or ambiguous."""
    for name in astuple(wanted):
        if name and name not in types:
            raise SourceError(f"bag has no topic {name}", f"It has {_list(types)}.")
    odometry = wanted.odometry or _only([t for t, kind in types.items() if kind == ODOMETRY])
    rgbd = [topic for topic, kind in types.items() if kind == RGBD]
    if rgbd and wanted.colour in ("", *rgbd) and not wanted.depth:
        topic = wanted.colour or _choose("RGBD", rgbd, types, "colour_topic")
        return Topics(topic, topic, "", "", odometry)
    images = [t for t, kind in types.items() if kind in (IMAGE, COMPRESSED)]
    images = [t for t in images if not any(word in t.lower() for word in OTHER_WORDS)]
    depths = [t for t in images if "depth" in t.lower()]
    colours = [t for t in images if t not in depths]
    depth = wanted.depth or _choose("depth", _narrow(depths, ALIGNED_WORDS), types, "depth_topic")
    colour = wanted.colour or _choose(
        "colour", _narrow(colours, COLOUR_WORDS), types, "colour_topic"
    )
    infos = [t for t, kind in types.items() if kind == CAMERA_INFO]
    return Topics(
        colour,
        depth,
        wanted.colour_info or _info_of(colour, infos),
        wanted.depth_info or _info_of(depth, infos),
        odometry,
    )


def _choose(what: str, topics: Sequence[str], types: Mapping[str, str], option: str) -> str:
    if not topics:
        raise SourceError(
            f"bag has no {what} images", f"It has {_list(types)}; set options.{option}."
        )
    streams = {_stream(topic) for topic in topics}
    if len(streams) > 1:
        raise SourceError(
            f"bag has several topics that could be {what}: {', '.join(sorted(topics))}",
            f"Set options.{option} to one of them.",
        )
    return min(topics, key=lambda topic: TRANSPORTS.index(topic.removeprefix(_stream(topic))))


def _narrow(topics: list[str], words: Sequence[str]) -> list[str]:
    """Return the topics named by one of the words, all if none is."""
    named = [topic for topic in topics if any(word in topic.lower() for word in words)]
    return named or topics


def _stream(topic: str) -> str:
    """Strip the transport, so that one stream sent raw and compressed counts once."""
    for transport in TRANSPORTS[1:]:
        topic = topic.removesuffix(transport)
    return topic


def _info_of(image: str, infos: Sequence[str]) -> str:
    """Find the camera_info beside an image topic, or the only one of its namespace."""
    namespace = _stream(image).rsplit("/", 1)[0]
    beside = f"{namespace}/camera_info"
    if beside in infos:
        return beside
    below = [topic for topic in infos if topic.startswith(f"{namespace}/")]
    return _only(below) or (infos[0] if len(infos) == 1 and "depth" not in image else "")


def _only(topics: Sequence[str]) -> str:
    return topics[0] if len(topics) == 1 else ""


def _list(types: Mapping[str, str]) -> str:
    listed = [f"{topic} ({kind.replace('/msg/', '/')})" for topic, kind in sorted(types.items())]
    return ", ".join(listed[:30]) or "no topics"
