"""ROS 1 and ROS 2 bags as typed messages, whatever their storage."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from common.errors import SourceError

RGBD_DEFINITION = """
std_msgs/Header header
sensor_msgs/CameraInfo rgb_camera_info
sensor_msgs/CameraInfo depth_camera_info
sensor_msgs/Image rgb
sensor_msgs/Image depth
"""


def ros2_types() -> Typestore:
    """Return the types of ROS 2 with realsense2_camera_msgs/RGBD, for bags that bring none."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(RGBD_DEFINITION, "realsense2_camera_msgs/msg/RGBD"))
    return store


class Bag:
    """A bag opened for reading, see `open_bag`.

    Args:
        path: File or folder, for errors.
        reader: The open reader.
    """

    def __init__(self, path: Path, reader: AnyReader) -> None:
        self._path = path
        self._reader = reader
        self.bad_messages = 0  # messages that could not be deserialised
        self.types = {c.topic: c.msgtype for c in reader.connections}
        self.counts: dict[str, int] = {}
        for connection in reader.connections:
            count = self.counts.get(connection.topic, 0) + connection.msgcount
            self.counts[connection.topic] = count
        self.duration_s = max(reader.duration, 0) / 1e9 if any(self.counts.values()) else 0.0

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, Any]]:
        """Iterate over the messages of some topics.

        Yields:
            Topic, time at which the bag received the message in nanoseconds, and the message.
            Messages that cannot be deserialised are skipped and counted in `bad_messages`.

        Raises:
            SourceError: The bag is damaged at this place.
        """
        connections = [c for c in self._reader.connections if c.topic in topics]
        if not connections:
            return
        with _told(self._path, "is damaged"):
            for connection, time_ns, data in self._reader.messages(connections):
                try:
                    message: Any = self._reader.deserialize(data, connection.msgtype)
                except Exception:  # the bytes are foreign: any error means they are not the type
                    self.bad_messages += 1
                    continue
                yield connection.topic, time_ns, message

    def first(self, topic: str) -> Any:
        """Return the first message of a topic.

        Raises:
            SourceError: There is none that can be read.
        """
        for _, _, message in self.messages([topic]):
            return message
        raise SourceError(f"bag {self._path} has no message on {topic} that can be read")


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a .bag, .db3 or .mcap file or the folder of a ROS 2 bag.

    Raises:
        SourceError: The bag is absent, cut short or damaged.
    """
    with _told(path, "cannot be opened"):
        reader = AnyReader([path], default_typestore=ros2_types())
        reader.open()
    try:
        with _told(path, "is damaged"):
            bag = Bag(path, reader)
        yield bag
    finally:
        reader.close()


@contextmanager
def _told(path: Path, what: str) -> Iterator[None]:
    """Turn whatever the reader raises on foreign bytes into one sentence."""
    try:
        yield
    except (SourceError, GeneratorExit):
        raise
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SourceError(
            f"bag {path} {what}: {reason[:200].rstrip('.')}",
            "Repair it with `rosbag reindex`, `ros2 bag reindex` or `mcap recover`.",
        ) from error
