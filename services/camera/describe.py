"""Contents of a recording, a bag or a folder, without playing it."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import msgspec

from common.io.recording import open_recording
from common.io.ros_bag import PEOPLE
from people4d.errors import SourceError
from people4d.messages import CameraInfo
from people4d.topics import prefix, topic_of_key
from services.camera.folder.source import TRACK, FolderOptions, FolderSource
from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.ros.camera import RosbagOptions
from services.camera.ros.source import RosbagSource
from services.camera.ros.types import ODOMETRY, open_bag
from services.camera.source import Source
from services.camera.sources import kind_of

FRAMES = ("CompressedRgbdFrame", "RgbdFrame")

S = TypeVar("S", bound=Source)


class TopicCount(msgspec.Struct, frozen=True, kw_only=True):
    """One stream of a recording."""

    name: str  # topic or key
    type: str  # message type; empty if the container does not say
    count: int  # messages


class Description(msgspec.Struct, frozen=True, kw_only=True):
    """Contents of a recording."""

    path: str
    kind: str  # recording, rosbag or folder
    topics: tuple[TopicCount, ...] = ()
    duration_s: float = 0.0  # [s] from the first to the last message or frame
    frames: int = 0  # colour images
    calibration: CameraInfo | None = None  # of colour; None if it cannot be played
    registered: bool = False  # True: depth is moved into the view of colour while playing
    mounted_in: str = ""  # parent frame of the camera; empty if unknown
    has_odometry: bool = False
    has_truth: bool = False  # motion capture, or the virtual lab's
    cut_short: bool = False  # True: it has no end mark; the messages before are readable
    problem: str = ""  # why it cannot be played; empty if it can


def describe(path: Path) -> Description:
    """Describe a recording, a ROS bag or a folder of images.

    Raises:
        SourceError: The path does not exist, is damaged, or is of no known kind.
    """
    kind = kind_of(str(path))
    if kind not in DESCRIBERS:
        raise SourceError(f"{path} is not a recording")
    return DESCRIBERS[kind](path)


def _recording(path: Path) -> Description:
    summary = open_recording(path).summary
    topics = tuple(
        TopicCount(name=name, type=_type_of(name), count=count)
        for name, count in summary.topics.items()
    )
    source, problem = _opened(lambda: RecordingSource(path, RecordingOptions()))
    return _with_source(
        Description(
            path=str(path),
            kind="recording",
            topics=topics,
            duration_s=summary.duration_s,
            frames=sum(t.count for t in topics if t.type in FRAMES),
            has_odometry="odometry" in summary.topics,
            has_truth="truth" in summary.topics,
            cut_short=summary.truncated,
            problem=problem,
        ),
        source,
    )


def _rosbag(path: Path) -> Description:
    with open_bag(path) as bag:
        types, counts, duration_s = bag.types, bag.counts, bag.duration_s
    source, problem = _opened(lambda: RosbagSource(path, RosbagOptions()))
    return _with_source(
        Description(
            path=str(path),
            kind="rosbag",
            topics=tuple(TopicCount(name=t, type=types[t], count=counts[t]) for t in sorted(types)),
            duration_s=duration_s,
            frames=counts[source.topics.colour] if source else 0,
            has_odometry=ODOMETRY in types.values(),
            has_truth=PEOPLE in types.values(),
            problem=problem,
        ),
        source,
    )


def _folder(path: Path) -> Description:
    source, problem = _opened(lambda: FolderSource(path, FolderOptions()))
    stamps = [pair.stamp_ns for pair in source.pairs] if source else [0]
    return _with_source(
        Description(
            path=str(path),
            kind="folder",
            duration_s=(max(stamps) - min(stamps)) / 1e9,
            frames=len(source.pairs) if source else 0,
            has_odometry=bool(source and source.has_odometry),
            has_truth=(path / TRACK).is_file(),
            problem=problem,
        ),
        source,
    )


def _opened(source: Callable[[], S]) -> tuple[S | None, str]:
    """Open a source, or return why it cannot be played."""
    try:
        return source(), ""
    except SourceError as error:
        return None, str(error)


def _with_source(description: Description, source: Source | None) -> Description:
    """Add the camera of the source."""
    if source is None:
        return description
    return msgspec.structs.replace(
        description,
        calibration=source.info,
        registered=source.registration is not None,
        mounted_in=next((transform.parent for transform in source.transforms), ""),
        problem=description.problem or ("" if description.frames else "it has no frames"),
    )


def _type_of(topic: str) -> str:
    """Return the message type of a key below people4d/v1/<robot>/, empty if it is of none."""
    known = topic_of_key(f"{prefix('robot')}/{topic}")
    return known.message.__name__ if known else ""


DESCRIBERS: dict[str, Callable[[Path], Description]] = {
    "recording": _recording,
    "rosbag": _rosbag,
    "folder": _folder,
}
