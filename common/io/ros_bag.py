"""ROS 1 and ROS 2 bags as typed messages, whatever their storage.

Only known types are read, since definitions in a bag would become code. A bag with a different type
of a known name is refused.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from common.io.ros_bag_files import bag_path
from common.io.ros_bag_guard import guarded, unzstd
from common.ros2 import types
from people4d.codec import MAX_BYTES
from people4d.errors import SourceError

PEOPLE = "people_msgs/msg/People"
# Shipped definitions that occur in bags of ROS 1 and ROS 2
SHIPPED = ("people_msgs/msg/Person", PEOPLE, "realsense2_camera_msgs/msg/RGBD")

# Digest of ROS 1 publishers that relay any type; only the name of the type is compared
ANY_DIGEST = "*"


def make_typestore(version: int, definitions: Mapping[str, str]) -> Typestore:
    """Return the types of ROS 1 (Noetic) or ROS 2 (Humble), with SHIPPED and additional types.

    Definitions are texts of additional types by name, in the order of their dependencies.
    """
    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    shipped = {name: types.definitions()[name] for name in SHIPPED}
    for name, text in (shipped | dict(definitions)).items():
        store.register(get_types_from_msg(text, name))
    return store


class Bag:
    """A bag opened for reading, see `open_bag`."""

    def __init__(self, path: Path, reader: Reader1 | Reader2, store: Typestore) -> None:
        self._path = path
        self._reader: Any = reader
        self._store = store
        self._ros1 = isinstance(reader, Reader1)
        self._compressed = _compressed_messages(reader)
        for connection in reader.connections:
            texts = (connection.topic, connection.msgtype, connection.digest)
            if not all(isinstance(text, str) for text in texts):
                raise ValueError(f"expected names of topics and types, got {texts!r:.80}")
        self.bad_messages = 0  # number of messages that could not be deserialised
        self.types = {c.topic: c.msgtype for c in reader.connections}
        self.counts = Counter[str]()
        for connection in reader.connections:
            self.counts[connection.topic] += connection.msgcount
        self.duration_s = max(reader.duration, 0) / 1e9 if any(self.counts.values()) else 0.0

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, Any]]:
        """Iterate over the messages of some topics.

        SourceError if the bag is damaged, or has another type of this name.

        Yields:
            Topic, reception time [ns], and the message. Messages that cannot be deserialised are
            skipped and counted in `bad_messages`.
        """
        connections = [c for c in self._reader.connections if c.topic in topics]
        if not connections:
            return
        for connection in connections:
            self._check_type(connection)
        with _source_errors(self._path, "is damaged"):
            for connection, time_ns, data in self._reader.messages(connections):
                try:
                    _check_time(time_ns)
                    message = self._message(data, connection.msgtype)
                except Exception:  # damaged bytes raise almost anything
                    self.bad_messages += 1
                    continue
                yield connection.topic, time_ns, message

    def first(self, topic: str) -> Any:
        """Return the first message of a topic, or raise SourceError."""
        for _, _, message in self.messages([topic]):
            return message
        raise SourceError(f"bag {self._path} has no message on {topic} that can be read")

    def _message(self, data: bytes, kind: str) -> Any:
        data = unzstd(data, MAX_BYTES) if self._compressed else data
        if len(data) > MAX_BYTES:
            raise ValueError(f"expected at most {MAX_BYTES} bytes, got {len(data)}")
        if self._ros1:
            return self._store.deserialize_ros1(data, kind)
        return self._store.deserialize_cdr(data, kind)

    def _check_type(self, connection: Connection) -> None:
        kind, digest = connection.msgtype, connection.digest
        if digest in ("", ANY_DIGEST) or kind not in self._store.fielddefs:
            return
        ours = self._store.generate_msgdef(kind)[1] if self._ros1 else self._store.hash_rihs01(kind)
        if digest != ours:
            raise SourceError(
                f"bag {self._path}: {connection.topic} differs from the known {kind}",
                "It was recorded with a changed definition of that type.",
            )


@contextmanager
def open_bag(path: Path, definitions: Mapping[str, str]) -> Iterator[Bag]:
    """Open a .bag, .db3 or .mcap file or the folder of a ROS 2 bag, untrusted.

    SourceError if the bag is absent, cut short, damaged, or exceeds the limits.
    """
    with ExitStack() as stack:
        with _source_errors(path, "cannot be opened"):
            path = bag_path(path)
            reader = stack.enter_context(guarded(path))
        with _source_errors(path, "is damaged"):
            store = make_typestore(1 if isinstance(reader, Reader1) else 2, definitions)
            bag = Bag(path, reader, store)
        yield bag


def _check_time(time_ns: object) -> None:
    # A database may have text in a column of numbers; MCAP has unsigned 64-bit numbers.
    if type(time_ns) is not int or not 0 <= time_ns < 2**62:
        raise ValueError(f"expected nanoseconds, got {time_ns!r:.40}")


def _compressed_messages(reader: Reader1 | Reader2) -> bool:
    """Check for individually compressed messages, and make the reader return them as stored."""
    if isinstance(reader, Reader1) or reader.compression_mode != "message":
        return False
    storage = reader.storage
    storage.metadata = storage.metadata._replace(compression_mode=None)
    return True


@contextmanager
def _source_errors(path: Path, problem: str) -> Iterator[None]:
    """Convert any error of the reader to a SourceError."""
    try:
        yield
    except (SourceError, GeneratorExit):
        raise
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SourceError(
            f"bag {path} {problem}: {reason[:200].rstrip('.')}",
            "Repair it with `rosbag reindex`, `ros2 bag reindex` or `mcap recover`.",
        ) from error
