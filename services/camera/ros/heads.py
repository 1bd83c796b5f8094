"""The beginning of a bag: sizes of images, their calibration, and the clock of their stamps."""

from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass
from itertools import islice
from typing import Any

from common.io.ros_bag import Bag
from common.ros2.transforms import stamp_of
from people4d.errors import DecodeError, SourceError
from people4d.messages import U8, U16
from services.camera.ros.camera_info import intrinsics_of, same_numbers
from services.camera.ros.images import colour_image, depth_image, encoding_of
from services.camera.ros.topics import COMPRESSED, IMAGE, Topics, sdk_stream

# Number of first images and calibrations. The most common one is used, since drivers change them
HEADS = 9
MAX_BAD_HEADS = 30  # maximum number of corrupt images of a usable topic: one second
STAMPED_HEADS = 30  # maximum number of messages examined for a stamp
MILLIMETRE = 0.001  # [m]
SIMULATED_NS = 10 * 10**9  # [ns] first stamps below this come from a simulated clock


@dataclass(frozen=True)
class ImageHead:
    """An image of a stream: its size (height, width), frame and CameraInfo."""

    size: tuple[int, int]
    frame: str
    info: Any | None


def read_heads(bag: Bag, topics: Topics) -> tuple[ImageHead, ImageHead]:
    """Return the most common image of colour and depth; SourceError if none can be read."""
    if topics.colour == topics.depth:
        rgbd = [message for _, _, message in islice(bag.messages([topics.colour]), MAX_BAD_HEADS)]
        return (
            _head(topics.colour, [m.rgb for m in rgbd], colour_image, _infos(rgbd, "rgb")),
            _head(topics.depth, [m.depth for m in rgbd], depth_image, _infos(rgbd, "depth")),
        )
    return (
        _topic_head(bag, topics.colour, topics.colour_info, colour_image),
        _topic_head(bag, topics.depth, topics.depth_info, depth_image),
    )


def simulated_topics(bag: Bag, topics: Collection[str]) -> frozenset[str]:
    """Return the topics with stamps from 0 s on, where a stamp of 0 is valid."""
    return frozenset(topic for topic in topics if 0 < _first_stamp_ns(bag, topic) < SIMULATED_NS)


def depth_unit_m(bag: Bag, depth: str) -> float:
    """Return the unit of 16-bit depth [m]: of librealsense, else a millimetre; or SourceError."""
    sensor = sdk_stream(depth).rpartition("/")[0]
    option = f"{sensor}/option/Depth_Units/value"
    if not sensor or option not in bag.types:
        return MILLIMETRE
    unit_m = float(getattr(bag.first(option), "data", 0.0))
    if not 1e-6 <= unit_m <= 1.0:  # including NaN
        raise SourceError(f"{option}: expected the unit of depth in metres, got {unit_m}")
    return unit_m


def encodings(bag: Bag) -> dict[str, str]:
    """Return the encoding of the first image of each topic of images, empty if it is unknown."""
    found = {}
    for topic, kind in bag.types.items():
        if kind in (IMAGE, COMPRESSED):
            first = next(bag.messages([topic]), None)
            found[topic] = encoding_of(first[2]) if first else ""
    return found


def _first_stamp_ns(bag: Bag, topic: str) -> int:
    """Return the first stamp of a topic that is not 0, else 0."""
    for _, _, message in islice(bag.messages([topic]), STAMPED_HEADS):
        stamped = getattr(message, "transforms", [message])
        stamps = [stamp_of(one) for one in stamped if hasattr(one, "header")]  # std_msgs: none
        if any(stamps):
            return max(stamps)
    return 0


def _infos(messages: list[Any], prefix: str) -> list[Any]:
    return [getattr(message, f"{prefix}_camera_info") for message in messages]


def _topic_head(
    bag: Bag, topic: str, info_topic: str, decode: Callable[[Any], U8 | U16]
) -> ImageHead:
    images = [message for _, _, message in islice(bag.messages([topic]), MAX_BAD_HEADS)]
    infos = [message for _, _, message in islice(bag.messages({info_topic} - {""}), HEADS)]
    if info_topic and not infos:
        raise SourceError(f"{info_topic} has no CameraInfo that can be read")
    return _head(topic, images, decode, infos)


def _head(
    topic: str, images: list[Any], decode: Callable[[Any], U8 | U16], infos: list[Any]
) -> ImageHead:
    reason, found = "it is empty", Counter[tuple[tuple[int, int], str]]()
    for message in images:
        try:
            height, width = decode(message).shape[:2]
        except DecodeError as error:
            reason = str(error)
            continue
        frame = (sdk_stream(topic) or str(message.header.frame_id)).strip("/")
        found[(height, width), frame] += 1
        if found.total() == HEADS:
            break
    if not found:
        raise SourceError(f"{topic} has no readable image: {reason}")
    (size, frame), _ = found.most_common(1)[0]
    return ImageHead(size, frame, _usual_info(infos, size, topic))


def _usual_info(infos: list[Any], size: tuple[int, int], topic: str) -> Any | None:
    """Return the most common CameraInfo that fits the images, else the first one."""
    fitting = [info for info in infos if _fits(info, size, topic)]
    return max(
        fitting or infos[:1],
        key=lambda info: sum(same_numbers(info, other) for other in fitting),
        default=None,
    )


def _fits(info: Any, size: tuple[int, int], topic: str) -> bool:
    try:
        intrinsics = intrinsics_of(info, topic)
    except SourceError:
        return False
    return (intrinsics.height or size[0], intrinsics.width or size[1]) == size
