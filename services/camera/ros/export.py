"""Recordings as ROS 2 bags, with the topics of a RealSense driver."""

import heapq
import shutil
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Literal, Self

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError

from common.geometry.transform_buffer import transform_from_odometry
from common.io.recording import open_recording
from common.ros2 import types
from common.ros2.messages.basic import ODOMETRY, TF, header, odometry, transforms
from common.ros2.messages.people import PEOPLE, people
from common.ros2.messages.person import RosPeopleView
from common.ros2.types import Fields
from people4d.errors import SourceError
from people4d.messages import CameraInfo, MovingTransform, StaticTransform, Tracks, Truth
from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.ros import messages as ros
from services.camera.ros.topics import CAMERA_INFO, COMPRESSED, IMAGE
from services.camera.source import MotionMessage, SourceFrame

VERSION: Literal[8] = 8  # version of the bag's metadata, readable from Humble on

STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}

ALWAYS = QosTime(2147483647, 4294967295)  # infinite duration: no deadline, endless lifespan
VOLATILE = Qos(
    QosHistory.KEEP_LAST,
    10,
    QosReliability.RELIABLE,
    QosDurability.VOLATILE,
    ALWAYS,
    ALWAYS,
    QosLiveliness.AUTOMATIC,
    ALWAYS,
    False,
)
LATCHED = VOLATILE._replace(depth=1, durability=QosDurability.TRANSIENT_LOCAL)


@dataclass(frozen=True, slots=True)
class BagFormat:
    """Format of a bag."""

    storage: str = "mcap"  # name in STORAGES
    compressed: bool = False  # colour as JPEG and depth as PNG instead of raw pixels
    namespace: str = "camera"  # first part of the image topics, the `camera_name` of a driver
    people: str = "nav2"  # convention of people_msgs, see `common.ros2.messages.people`


ExportItem = SourceFrame | MotionMessage | Truth | Tracks
BagEntry = tuple[str, str, Fields]  # topic, type and fields of a message


def export(
    recording: Path,
    out: Path,
    bag_format: BagFormat = BagFormat(),
    camera: str = "",
    on_progress: Callable[[float], object] = float,
) -> dict[str, int]:
    """Write one camera of a recording, odometry, people and truth to a new ROS 2 bag.

    SourceError if the recording cannot be played, or the bag exists or cannot be written.

    Args:
        recording: Recording to export.
        out: Folder of the bag; must not exist.
        bag_format: Format of the bag.
        camera: Name of the camera; may be empty if there is only one.
        on_progress: Called with the progress, 0 to 1.

    Returns:
        Number of messages by topic.
    """
    source = RecordingSource(recording, RecordingOptions(camera=camera))
    people = (
        message
        for _, message in open_recording(recording).messages(Truth, Tracks)
        if isinstance(message, Truth | Tracks)
    )
    items: Iterator[ExportItem] = heapq.merge(source, people, key=lambda item: item.stamp_ns)
    duration_ns = max(1, round(open_recording(recording).summary.duration_s * 1e9))
    first = next(items, None)
    if first is None:
        raise SourceError(f"recording {recording} has nothing that ROS has messages for")
    with BagWriter(out, source.info, bag_format) as bag:
        bag.write_transforms(source.transforms, first.stamp_ns)
        for item in chain([first], items):
            bag.write(item)
            on_progress(min(1.0, (item.stamp_ns - first.stamp_ns) / duration_ns))
    return bag.counts


class BagWriter:
    """Writes a new ROS 2 bag or raises SourceError; a `with` block removes it after an error."""

    def __init__(self, path: Path, info: CameraInfo, bag_format: BagFormat = BagFormat()) -> None:
        self.counts = Counter[str]()  # messages by topic
        self._path = path
        self._info = info
        self._format = bag_format
        self._truth, self._tracks = RosPeopleView(), RosPeopleView()
        self._connections: dict[str, Connection] = {}
        try:
            plugin = STORAGES[bag_format.storage]
            self._writer = Writer(path, version=VERSION, storage_plugin=plugin)
            self._writer.open()
        except (OSError, WriterError) as error:
            raise SourceError(f"bag {path} cannot be written: {error}") from error

    def write(self, item: ExportItem) -> None:
        """Append an item at the time of its stamp; SourceError if that fails."""
        for entry in self._entries(item):
            self._append(entry, item.stamp_ns)

    def write_transforms(self, static: Sequence[StaticTransform], time_ns: int) -> None:
        """Append static transforms, which late subscribers also receive."""
        if static:
            edges = ((one.parent, one.child, one.matrix) for one in static)
            self._append(("/tf_static", TF, transforms(edges, time_ns)), time_ns)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            with self._source_errors():
                self._writer.close()
        else:
            self._writer.abort()
            shutil.rmtree(self._path, ignore_errors=True)

    def _entries(self, item: ExportItem) -> list[BagEntry]:
        if isinstance(item, SourceFrame):
            return self._frame(item)
        if isinstance(item, Truth):
            return [("/truth", PEOPLE, people(self._truth.truth(item), self._format.people))]
        if isinstance(item, Tracks):
            tracks = self._tracks.tracks(item, groups={})
            return [("/people", PEOPLE, people(tracks, self._format.people))]
        if isinstance(item, MovingTransform):
            edge = item.parent, item.child, item.matrix
            return [("/tf", TF, transforms([edge], item.stamp_ns))]
        base = item.frame_id, item.child_frame_id, transform_from_odometry(item)
        return [("/odom", ODOMETRY, odometry(item)), ("/tf", TF, transforms([base], item.stamp_ns))]

    def _frame(self, frame: SourceFrame) -> list[BagEntry]:
        head = header(frame.stamp_ns, self._info.frame_id)
        colour, depth = (
            f"/{self._format.namespace}/{stream}" for stream in ("color", "aligned_depth_to_color")
        )
        info = ros.camera_info(self._info, head)
        entries = [(f"{name}/camera_info", CAMERA_INFO, info) for name in (colour, depth)]
        colour, depth = f"{colour}/image_raw", f"{depth}/image_raw"
        if self._format.compressed:
            return [
                *entries,
                (f"{colour}/compressed", COMPRESSED, ros.compressed_image(frame.rgb, head)),
                (
                    f"{depth}/compressedDepth",
                    COMPRESSED,
                    ros.compressed_image(frame.depth_mm, head),
                ),
            ]
        return [
            *entries,
            (colour, IMAGE, ros.image(frame.rgb, head)),
            (depth, IMAGE, ros.image(frame.depth_mm, head)),
        ]

    def _append(self, entry: BagEntry, time_ns: int) -> None:
        topic, kind, fields = entry
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic,
                kind,
                typestore=types.typestore(),
                offered_qos_profiles=[LATCHED if topic == "/tf_static" else VOLATILE],
            )
        with self._source_errors():
            data = types.encode(kind, fields)
            self._writer.write(self._connections[topic], max(time_ns, 0), data)
        self.counts[topic] += 1

    @contextmanager
    def _source_errors(self) -> Iterator[None]:
        try:
            yield
        except (OSError, sqlite3.Error) as error:
            raise SourceError(f"bag {self._path} cannot be written: {error}") from error
