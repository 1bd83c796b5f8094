"""Limits of a ROS bag, checked before and while rosbags reads it.

rosbags does not check the unpacked size and the number of chunks, views and computed columns of a
database, or YAML. They are bounded here.
"""

import contextlib
import sqlite3
from bz2 import BZ2Decompressor
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import quote

import lz4.frame
import zstandard
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import reader as rosbag1_reader
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2 import reader as rosbag2_reader
from rosbags.rosbag2 import storage_mcap, storage_sqlite3
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.nodes import MappingNode

from common.io.files import MAX_CHARACTERS, inside, parse_yaml, read_text
from common.io.ros_bag_files import check_written

MAX_CHUNK_BYTES = 256 * 2**20  # maximum size of an unpacked chunk; the default of writers is 1 MB
# Maximum total size of chunks with overlapping times, which are in memory together
MAX_OPEN_BYTES = 512 * 2**20
MAX_RATIO = 200  # maximum compression ratio of a file; images reach 3 to 10
MAX_FILES = 1024  # maximum number of files of a ROS 2 bag
MAX_STEPS = 10**8  # maximum number of steps of the database in the check: some seconds
BLOCK_BYTES = 2**20
YAML_MAP, YAML_MERGE = "tag:yaml.org,2002:map", "tag:yaml.org,2002:merge"


def harden() -> None:
    """Limit the bytes that rosbags unpacks and the YAML that it expands.

    The functions replace entries in tables of its readers and its YAML parser. Valid bags are
    unaffected.
    """
    rosbag1_reader.decompressors.update(bz2=_bz2, lz4=_lz4)
    storage_mcap.DECOMPRESSORS.update(lz4=_lz4, zstd=unzstd)
    SafeConstructor.add_constructor(YAML_MAP, _yaml_map)
    plugins: Any = rosbag2_reader.DirectoryReader.STORAGE_PLUGINS
    plugins.update(sqlite3=QuotedSqlite3Reader)
    plugins = Reader2.STORAGE_PLUGINS
    plugins.update({".db3": QuotedSqlite3Reader})


def unzstd(data: bytes, limit: int = MAX_CHUNK_BYTES) -> bytes:
    """Unpack zstd data; ValueError if they exceed the limit in bytes."""
    limit = min(limit, MAX_CHUNK_BYTES)
    with zstandard.ZstdDecompressor().stream_reader(BytesIO(data), read_across_frames=True) as part:
        return _bounded(part.read(limit + 1), limit)


class QuotedSqlite3Reader(storage_sqlite3.Sqlite3Reader):
    """Opens databases whose path has characters of a URI (# ? %), which rosbags does not quote."""

    def __init__(self, path: Path) -> None:
        super().__init__(Path(quote(str(path))))


class GuardedReader1(Reader1):
    """Reads ROS 1 bags whose index is not larger than the file."""

    def open(self) -> None:
        """Open the bag."""
        with self.path.open("rb") as file:
            # Otherwise its first line would be searched to the end
            if file.read(9) != b"#ROSBAG V":
                raise ValueError("it has no signature of a bag")
            self._left = file.seek(0, 2)
        super().open()

    def read_index_data(self, pos: int, indexes: Any) -> None:
        """Read a part of the index once, even if chunks share it."""
        file: Any = self.bio
        start = file.tell()
        super().read_index_data(pos, indexes)
        self._left -= file.tell() - start
        if self._left < 0:
            raise ValueError("its chunks share their index")


@contextlib.contextmanager
def guarded(path: Path) -> Iterator[Reader1 | Reader2]:
    """Open a bag with a reader of rosbags; a damaged bag raises arbitrary exceptions."""
    harden()
    if path.suffix == ".bag":
        with GuardedReader1(path) as reader1:
            yield reader1
        return
    for file in _files(path):
        if file.suffix == ".db3":
            check_written(file)
            _check_database(file)
    with Reader2(path) as reader2:
        storage: Any = reader2.storage
        for part in getattr(storage, "storages", [storage]):
            _check_chunks(getattr(part, "chunks", ()))
        yield reader2


def _files(path: Path) -> Sequence[Path]:
    """Return the files of a ROS 2 bag, checked to lie in its folder."""
    if not path.is_dir():
        return [path]
    metadata = parse_yaml(read_text(path / "metadata.yaml", MAX_CHARACTERS))
    try:
        about = metadata["rosbag2_bagfile_information"]
        names = [PurePath(name).name for name in about["relative_file_paths"]]
        packed = str(about.get("compression_mode") or "").lower() == "file"
    except (TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"metadata.yaml lacks {error}") from error
    if len(names) > MAX_FILES or len(set(names)) < len(names):
        raise ValueError("metadata.yaml names a file twice, or too many")
    files = [inside(path, name) for name in names]
    if packed:
        for file in files:
            _check_packed(file)
    return files


def _check_packed(file: Path) -> None:
    """Check that a file unpacked to disk does not fill the disk."""
    left = MAX_CHUNK_BYTES + MAX_RATIO * file.stat().st_size
    with (
        file.open("rb") as data,
        zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as part,
    ):
        while block := part.read(BLOCK_BYTES):
            left -= len(block)
            if left < 0:
                raise ValueError(f"{file.name} unpacks to more than {MAX_RATIO} times its size")


def _check_chunks(chunks: Sequence[Any]) -> None:
    """Check the total size of chunks in memory together."""
    changes = [(c.message_start_time, c.uncompressed_size) for c in chunks]
    changes += [(c.message_end_time + 1, -c.uncompressed_size) for c in chunks]
    open_bytes = 0
    for _, change in sorted(changes):
        open_bytes += change
        if open_bytes > MAX_OPEN_BYTES:
            raise ValueError("too many of its chunks have the same time")


def _check_database(file: Path) -> None:
    """Check that a database has only tables, without views and generated columns, which compute."""
    with contextlib.closing(
        sqlite3.connect(f"{file.absolute().as_uri()}?immutable=1&mode=ro", uri=True)
    ) as database:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_CHUNK_BYTES)
        database.execute("PRAGMA trusted_schema=OFF")
        steps = iter(range(MAX_STEPS // 10_000))
        database.set_progress_handler(lambda: next(steps, None) is None, 10_000)
        for kind, name, text in database.execute("SELECT type, name, sql FROM sqlite_master"):
            if kind not in ("table", "index") or "virtual" in str(text).lower():
                raise ValueError(f"its database has a {kind} {name!r:.40}")
            columns = database.execute("SELECT hidden FROM pragma_table_xinfo(?)", (name,))
            if any(hidden for (hidden,) in columns):
                raise ValueError(f"its database computes columns of {name!r:.40}")
        twice = "SELECT count(*) > count(DISTINCT id) FROM topics"
        if database.execute(twice).fetchone()[0]:
            raise ValueError("its database has topics of the same number")


def _bz2(data: bytes) -> bytes:
    return _bounded(BZ2Decompressor().decompress(data, MAX_CHUNK_BYTES + 1), MAX_CHUNK_BYTES)


def _lz4(data: bytes, limit: int = MAX_CHUNK_BYTES) -> bytes:
    limit = min(limit, MAX_CHUNK_BYTES)
    unpacker = lz4.frame.LZ4FrameDecompressor()
    return _bounded(unpacker.decompress(data, limit + 1), limit)


def _bounded(data: bytes, limit: int) -> bytes:
    if len(data) > limit:
        raise ValueError(f"a chunk unpacks to more than {limit} bytes")
    return data


def _yaml_map(constructor: SafeConstructor, node: MappingNode) -> Iterator[dict[Any, Any]]:
    """Construct a map as ruamel does, but reject merge keys, which can grow exponentially."""
    if any(key.tag == YAML_MERGE for key, _ in node.value):
        raise ValueError("its YAML has merge keys (<<), which are not supported")
    yield from constructor.construct_yaml_map(node)
