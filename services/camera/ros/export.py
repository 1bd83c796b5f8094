"""Our recordings as ROS 2 bags, with the topics of a RealSense driver."""

import heapq
import shutil
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

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

from common.io.images import encode_jpeg, encode_png16
from common.io.recording import open_recording
from people4d.errors import SourceError
from people4d.messages import CameraInfo, MovingTransform, Odometry, StaticTransform, Tracks, Truth
from services.camera.recording import RecordingOptions, RecordingSource
from services.camera.ros.messages import PEOPLE, RosMessages, export_types
from services.camera.source import MotionMessage, SourceFrame

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
VERSION: Literal[8] = 8  # of the bag's metadata: what ROS 2 from Humble on reads
QUALITY = 95  # of JPEG colour, so that coding it a second time adds little

STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}

ALWAYS = QosTime(2147483647, 4294967295)  # no deadline, endless lifespan
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
    """How a bag is written.

    Args:
        storage: Name in STORAGES.
        compressed: Colour as JPEG and depth as PNG instead of raw pixels.
        namespace: First part of the image topics, the `camera_name` of a driver.
    """

    storage: str = "mcap"
    compressed: bool = False
    namespace: str = "camera"


ExportItem = SourceFrame | MotionMessage | Truth | Tracks
BagEntry = tuple[str, str, Any]  # topic, type and message


def export(
    recording: Path,
    out: Path,
    layout: BagFormat = BagFormat(),
    camera: str = "",
    progress: Callable[[float], object] = float,
) -> dict[str, int]:
    """Write one camera of a recording, odometry, people and truth to a new ROS 2 bag.

    Args:
        recording: File of ours.
        out: Folder of the bag; must not exist.
        layout: How the bag is written.
        camera: Which camera; may be empty where there is only one.
        progress: Called with the share of the recording that is done, 0 to 1.

    Returns:
        Number of messages by topic.

    Raises:
        SourceError: The recording cannot be played, or the bag exists or cannot be written.
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
    with BagWriter(out, source.info, layout) as bag:
        bag.write_transforms(source.transforms, first.stamp_ns)
        for item in chain([first], items):
            bag.write(item)
            progress(min(1.0, (item.stamp_ns - first.stamp_ns) / duration_ns))
    return bag.counts


class BagWriter:
    """Writes a new ROS 2 bag; use it in a `with` block.

    If the block ends with an error, nothing of the bag is left.

    Args:
        path: Folder of the bag; must not exist.
        info: Calibration of colour.
        layout: How it is written.

    Raises:
        SourceError: The folder exists or cannot be written.
    """

    def __init__(self, path: Path, info: CameraInfo, layout: BagFormat = BagFormat()) -> None:
        self.counts: dict[str, int] = {}  # messages by topic
        self._path = path
        self._info = info
        self._layout = layout
        self._store = export_types()
        self._ros = RosMessages(self._store)
        self._connections: dict[str, Connection] = {}
        try:
            plugin = STORAGES[layout.storage]
            self._writer = Writer(path, version=VERSION, storage_plugin=plugin)
            self._writer.open()
        except (OSError, WriterError) as error:
            raise SourceError(f"bag {path} cannot be written: {error}") from error

    def write(self, item: ExportItem) -> None:
        """Append what a camera, a tracker or motion capture saw, at the time of its stamp.

        Raises:
            SourceError: The bag cannot be written, for example because the disk is full.
        """
        for entry in self._entries(item):
            self._append(entry, item.stamp_ns)

    def write_transforms(self, transforms: Sequence[StaticTransform], time_ns: int) -> None:
        """Append what does not move, for late subscribers too."""
        if transforms:
            message = self._ros.transforms(transforms, time_ns)
            self._append(("/tf_static", TRANSFORMS, message), time_ns)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            with self._told():
                self._writer.close()
        else:
            self._writer.abort()
            shutil.rmtree(self._path, ignore_errors=True)

    def _entries(self, item: ExportItem) -> list[BagEntry]:
        ros = self._ros
        if isinstance(item, Odometry):
            return [
                ("/odom", "nav_msgs/msg/Odometry", ros.odometry(item)),
                ("/tf", TRANSFORMS, ros.base_transform(item)),
            ]
        if isinstance(item, MovingTransform):
            return [("/tf", TRANSFORMS, ros.transforms([item], item.stamp_ns))]
        if isinstance(item, Truth):
            return [("/truth", PEOPLE, ros.truth(item))]
        if isinstance(item, Tracks):
            return [("/people", PEOPLE, ros.tracks(item))]
        return self._frame(item)

    def _frame(self, capture: SourceFrame) -> list[BagEntry]:
        ros, stamp_ns, frame = self._ros, capture.stamp_ns, self._info.frame_id
        colour, depth = (
            f"/{self._layout.namespace}/{stream}" for stream in ("color", "aligned_depth_to_color")
        )
        info = ros.camera_info(self._info, stamp_ns)
        infos: list[BagEntry] = [(f"{name}/camera_info", INFO, info) for name in (colour, depth)]
        if self._layout.compressed:
            jpeg, png = encode_jpeg(capture.rgb, QUALITY), encode_png16(capture.depth_mm)
            return [
                *infos,
                (f"{colour}/image_raw/compressed", COMPRESSED, ros.jpeg(jpeg, stamp_ns, frame)),
                (
                    f"{depth}/image_raw/compressedDepth",
                    COMPRESSED,
                    ros.depth_png(png, stamp_ns, frame),
                ),
            ]
        return [
            *infos,
            (f"{colour}/image_raw", IMAGE, ros.image(capture.rgb, "rgb8", stamp_ns, frame)),
            (f"{depth}/image_raw", IMAGE, ros.image(capture.depth_mm, "16UC1", stamp_ns, frame)),
        ]

    def _append(self, entry: BagEntry, time_ns: int) -> None:
        topic, kind, message = entry
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic,
                kind,
                typestore=self._store,
                offered_qos_profiles=[LATCHED if topic == "/tf_static" else VOLATILE],
            )
        with self._told():
            data = self._store.serialize_cdr(message, kind)
            self._writer.write(self._connections[topic], max(time_ns, 0), data)
        self.counts[topic] = self.counts.get(topic, 0) + 1

    @contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except (OSError, sqlite3.Error) as error:
            raise SourceError(f"bag {self._path} cannot be written: {error}") from error
