"""Contents of a recording, a bag or a folder, without playing it."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import msgspec

from common.calibration.transforms_file import MAP
from common.io.recording import open_recording
from common.io.ros_bag import PEOPLE
from people4d.errors import SourceError
from people4d.messages import CameraInfo, Odometry
from people4d.topics import prefix, topic_of_key
from services.camera.folder.source import TRACK, FolderSource
from services.camera.frame_check import FrameCheck
from services.camera.ros.source import RosbagSource
from services.camera.ros.topics import ODOMETRY, open_bag
from services.camera.source import Source, SourceFrame
from services.camera.sources import kind_of, open_source
from services.camera.upright import turns_of

FRAMES = ("CompressedRgbdFrame", "RgbdFrame")


class TopicCount(msgspec.Struct, frozen=True, kw_only=True):
    """One stream of a recording."""

    name: str  # topic or key
    type: str  # message type; empty if unknown
    count: int  # number of messages


class Description(msgspec.Struct, frozen=True, kw_only=True):
    """Contents of a recording."""

    path: str
    kind: str  # recording, rosbag or folder
    topics: tuple[TopicCount, ...] = ()
    duration_s: float = 0.0  # [s] time from the first to the last message or frame
    frames: int = 0  # number of colour images
    calibration: CameraInfo | None = None  # calibration of colour; None if it cannot be played
    registered: bool = False  # True: depth is moved into the view of colour while playing
    mounted_in: str = ""  # parent frame of the camera; empty if unknown
    turned_deg: int = 0  # [deg] clockwise turn that makes images upright
    has_odometry: bool = False
    unlinked_odometry: str = ""  # frame of odometry without a transform to the map
    has_truth: bool = False  # True with ground truth, from motion capture or simulation
    cut_short: bool = False  # True without an end mark; the messages are readable
    problem: str = ""  # reason why it cannot be played; empty if it can


def describe(path: Path) -> Description:
    """Describe a recording, a ROS bag or a folder of images; SourceError if it is damaged."""
    kind = kind_of(str(path))
    if kind not in DESCRIBERS:
        raise SourceError(f"{path} is not a recording")
    source, problem = None, ""
    try:
        source = open_source(str(path))
    except SourceError as error:
        problem = str(error)
    description = DESCRIBERS[kind](path, source)
    if source is None:
        return msgspec.structs.replace(description, problem=problem)
    fault, odometry_frame = _try_out(source) if description.frames else ("it has no frames", "")
    linked = {transform.child for transform in source.transforms if transform.parent == MAP}
    return msgspec.structs.replace(
        description,
        calibration=source.info,
        registered=source.registration is not None,
        mounted_in=next((transform.parent for transform in source.transforms), ""),
        turned_deg=0 if source.moves else 90 * turns_of(source.transforms, source.info.frame_id),
        unlinked_odometry="" if source.moves or odometry_frame in linked else odometry_frame,
        problem=fault,
    )


def _try_out(source: Source) -> tuple[str, str]:
    """Return the reason why no frame can be played, or empty, and the frame of odometry."""
    check, odometry_frame = FrameCheck(source.info), ""
    try:
        for item in source:
            if isinstance(item, Odometry):
                odometry_frame = item.frame_id
            elif isinstance(item, SourceFrame) and check.accept(item):
                return "", odometry_frame
    except SourceError as error:
        return str(error), odometry_frame
    dropped = Counter(check.counters) + Counter(source.counters)
    listed = ", ".join(f"{name} {count}" for name, count in dropped.items())
    fault = check.fault or "no frame of it can be played"
    return f"{fault} ({listed})" if listed else fault, odometry_frame


def _recording(path: Path, _: Source | None) -> Description:
    summary = open_recording(path).summary
    topics = tuple(
        TopicCount(name=name, type=_type_of(name), count=count)
        for name, count in summary.topics.items()
    )
    return Description(
        path=str(path),
        kind="recording",
        topics=topics,
        duration_s=summary.duration_s,
        frames=sum(topic.count for topic in topics if topic.type in FRAMES),
        has_odometry="odometry" in summary.topics,
        has_truth="truth" in summary.topics,
        cut_short=summary.truncated,
    )


def _rosbag(path: Path, source: Source | None) -> Description:
    with open_bag(path) as bag:
        types, counts, duration_s = bag.types, bag.counts, bag.duration_s
    return Description(
        path=str(path),
        kind="rosbag",
        topics=tuple(TopicCount(name=t, type=types[t], count=counts[t]) for t in sorted(types)),
        duration_s=duration_s,
        frames=counts[source.topics.colour] if isinstance(source, RosbagSource) else 0,
        has_odometry=ODOMETRY in types.values(),
        has_truth=PEOPLE in types.values(),
    )


def _folder(path: Path, source: Source | None) -> Description:
    pairs = source.pairs if isinstance(source, FolderSource) else ()
    stamps = [pair.stamp_ns for pair in pairs] or [0]
    return Description(
        path=str(path),
        kind="folder",
        duration_s=(max(stamps) - min(stamps)) / 1e9,
        frames=len(pairs),
        has_odometry=isinstance(source, FolderSource) and bool(source.odometry),
        has_truth=(path / TRACK).is_file(),
    )


def _type_of(topic: str) -> str:
    """Return the message type of a key below people4d/v1/<robot>/, empty if unknown."""
    known = topic_of_key(f"{prefix('robot')}/{topic}")
    return known.message.__name__ if known else ""


DESCRIBERS: dict[str, Callable[[Path, Source | None], Description]] = {
    "recording": _recording,
    "rosbag": _rosbag,
    "folder": _folder,
}
