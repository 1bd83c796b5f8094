"""Untrusted ROS bags: bounded cost, no code from the file."""

import bz2
import sqlite3
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lz4.frame
import pytest
import yaml
import zstandard
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import CompressionFormat, CompressionMode

from common.io import ros_bag_guard
from common.io.files import parse_yaml
from common.io.ros_bag import make_typestore, open_bag
from people4d.errors import SourceError

TEXT = "std_msgs/msg/String"


def text(version: int, data: str = "hello") -> bytes:
    store = make_typestore(version, {})
    message = store.types[TEXT](data=data)
    if version == 1:
        return bytes(store.serialize_ros1(message, TEXT))
    return bytes(store.serialize_cdr(message, TEXT))


def write1(path: Path, compression: str = "", count: int = 3) -> Path:
    bag = rosbag1.Writer(path)
    if compression:
        bag.set_compression(rosbag1.Writer.CompressionFormat[compression])
    with bag as writer:
        link = writer.add_connection("/text", TEXT, typestore=make_typestore(1, {}))
        for k in range(count):
            writer.write(link, k, text(1))
    return path


def write2(path: Path, storage: str = "MCAP", mode: str = "NONE", data: bytes = text(2)) -> Path:
    bag = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage])
    if mode != "NONE":
        bag.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with bag as writer:
        link = writer.add_connection("/text", TEXT, typestore=make_typestore(2, {}))
        for k in range(3):
            writer.write(link, k, data)
    return path


def read(path: Path) -> list[str]:
    with open_bag(path, {}) as bag:
        return [message.data for _, _, message in bag.messages(["/text"])]


def refusal(path: Path) -> str:
    with pytest.raises(SourceError) as caught:
        read(path)
    return str(caught.value)


@pytest.mark.parametrize("compression", ["", "BZ2", "LZ4"])
def test_ros_1(compression: str, tmp_path: Path) -> None:
    assert read(write1(tmp_path / "a.bag", compression)) == ["hello"] * 3


@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        ("MCAP", "NONE"),
        ("MCAP", "STORAGE"),
        ("SQLITE3", "NONE"),
        ("SQLITE3", "MESSAGE"),
        ("SQLITE3", "FILE"),
    ],
)
def test_ros_2(storage: str, mode: str, tmp_path: Path) -> None:
    assert read(write2(tmp_path / "a", storage, mode)) == ["hello"] * 3


LIMIT = 2**20
ZEROS = bytes(64 * LIMIT)
PACKERS: dict[str, Callable[[bytes], bytes]] = {
    "BZ2": bz2.compress,
    "LZ4": lz4.frame.compress,
    "ZSTD": zstandard.compress,
}


@pytest.fixture
def limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The limits of a chunk and of a file that is unpacked, made small so that tests are quick."""
    monkeypatch.setattr(ros_bag_guard, "MAX_CHUNK_BYTES", LIMIT)


def peak_of(path: Path) -> tuple[str, int]:
    tracemalloc.start()
    try:
        return refusal(path), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.usefixtures("limit")
@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_a_chunk_of_ros_1_is_not_unpacked_beyond_a_limit(compression: str, tmp_path: Path) -> None:
    with rosbag1.Writer(tmp_path / "a.bag") as writer:
        writer.compression_format = compression.lower()
        writer.compressor = lambda _: PACKERS[compression](ZEROS)
        link = writer.add_connection("/text", TEXT, typestore=make_typestore(1, {}))
        writer.write(link, 1, text(1))
    message, peak = peak_of(tmp_path / "a.bag")
    assert "unpacks to more than 1048576 bytes" in message
    assert peak < 32 * LIMIT


@pytest.mark.usefixtures("limit")
@pytest.mark.parametrize("compression", ["LZ4", "ZSTD"])
@pytest.mark.parametrize("indexed", [True, False])
def test_a_chunk_of_mcap_is_not_unpacked_beyond_a_limit(
    compression: str, indexed: bool, tmp_path: Path
) -> None:
    with rosbag2.Writer(
        tmp_path / "a", version=9, storage_plugin=rosbag2.StoragePlugin.MCAP
    ) as writer:
        storage: Any = writer.storage
        storage.compression = compression.lower()
        storage.compressor = lambda _: PACKERS[compression](ZEROS)
        link = writer.add_connection("/text", TEXT, typestore=make_typestore(2, {}))
        writer.write(link, 1, text(2))
    path = tmp_path / "a" / "a.mcap"
    if not indexed:
        data = path.read_bytes()
        path.write_bytes(data[:-28] + bytes(8) + data[-20:])  # the summary starts nowhere
    message, peak = peak_of(path)
    assert "unpacks to more than" in message
    assert peak < 32 * LIMIT


@pytest.mark.usefixtures("limit")
def test_a_packed_file_that_would_fill_the_disk_is_not_unpacked(tmp_path: Path) -> None:
    path = write2(tmp_path / "a", "SQLITE3", "FILE")
    next(path.glob("*.zstd")).write_bytes(PACKERS["ZSTD"](ZEROS))
    assert "unpacks to more than 200 times its size" in refusal(path)


@pytest.mark.slow
def test_a_packed_message_is_not_unpacked_beyond_a_limit(tmp_path: Path) -> None:
    path = write2(tmp_path / "a", "SQLITE3", "MESSAGE")
    with sqlite3.connect(path / "a.db3") as database:
        database.execute("UPDATE messages SET data = ? WHERE id = 2", (PACKERS["ZSTD"](ZEROS * 2),))
    with open_bag(path, {}) as bag:
        assert len(list(bag.messages(["/text"]))) == 2
        assert bag.bad_messages == 1


@pytest.mark.slow
def test_chunks_that_share_their_index_do_not_multiply_it(tmp_path: Path) -> None:
    data = write1(tmp_path / "a.bag", count=300).read_bytes()
    at = data.index(b"op=\x06") - 8  # the record of the only chunk, to the end of the file
    count = data.index(b"chunk_count=") + len(b"chunk_count=")
    data = data[:count] + struct.pack("<I", 500) + data[count + 4 : at] + data[at:] * 500
    (tmp_path / "a.bag").write_bytes(data)
    assert "its chunks share their index" in refusal(tmp_path / "a.bag")


def test_chunks_of_the_same_time_are_not_all_held_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write2(tmp_path / "a", data=text(2, "x" * 600_000)) / "a.mcap"
    assert len(read(path)) == 3
    monkeypatch.setattr(ros_bag_guard, "MAX_OPEN_BYTES", 1_000_000)
    assert "too many of its chunks have the same time" in refusal(path)


HOSTILE_SQL = {
    "a view": "ALTER TABLE schema RENAME TO s; CREATE VIEW schema AS WITH RECURSIVE n(k) AS "
    "(SELECT 1 UNION ALL SELECT k + 1 FROM n) SELECT max(k) AS schema_version FROM n;",
    "a trigger": "CREATE TRIGGER t AFTER INSERT ON topics BEGIN SELECT 1; END;",
    "a table": "CREATE VIRTUAL TABLE v USING fts5(x);",
    "computes columns of": "ALTER TABLE messages RENAME TO m; CREATE TABLE messages(id, topic_id, "
    "timestamp, data GENERATED ALWAYS AS (zeroblob(900000000)));",
    "topics of the same number": "ALTER TABLE topics RENAME TO t; CREATE TABLE topics AS SELECT * "
    "FROM t UNION ALL SELECT * FROM t;",
}


@pytest.mark.parametrize("message", HOSTILE_SQL)
def test_a_database_that_computes_is_refused(message: str, tmp_path: Path) -> None:
    path = write2(tmp_path / "a", "SQLITE3") / "a.db3"
    with sqlite3.connect(path) as database:
        database.executescript(HOSTILE_SQL[message])
    assert message in refusal(path)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (["a.db3", "a.db3"], "names a file twice"),
        (["link.db3"], "leads out of the folder"),
        ([".."], "leads out of the folder"),
        (["../other.db3"], "unable to open"),  # the name counts, not the folder
        ([3], "lacks"),
        ("a.db3", "expected the name of a file"),
        (None, "lacks"),
    ],
)
def test_the_files_of_a_bag_are_those_of_its_folder(
    files: Any, message: str, tmp_path: Path
) -> None:
    path = write2(tmp_path / "a", "SQLITE3")
    (tmp_path / "other.db3").write_bytes((path / "a.db3").read_bytes())
    (path / "link.db3").symlink_to("../other.db3")
    about = yaml.safe_load((path / "metadata.yaml").read_text())
    about["rosbag2_bagfile_information"]["relative_file_paths"] = files
    (path / "metadata.yaml").write_text(yaml.safe_dump(about))
    assert message in refusal(path)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("a: &a [1]\nb: *a", "it has aliases"),
        ("[" * 100_000, "nested too deeply"),
        ("a: " * 50 + "1", "mapping values are not allowed"),
        ("x" * 300_000, "longer than"),
        ("!!python/object/apply:os.system ['true']", "could not determine a constructor"),
    ],
)
def test_yaml_says_no_more_than_it_holds(data: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        parse_yaml(data)
    path = write2(tmp_path / "a")
    (path / "metadata.yaml").write_text(data)
    assert "cannot be opened" in refusal(path)


def test_no_code_is_made_from_the_definitions_of_a_bag(tmp_path: Path) -> None:
    # An array of an empty type: two numbers on disk, and four billion objects in memory.
    path = write1(tmp_path / "a.bag")
    data = path.read_bytes()
    assert b"string data" in data
    path.write_bytes(data.replace(b"string data", b"E[] dataaaa"))
    assert read(path) == ["hello"] * 3


def test_another_type_of_the_same_name_is_refused(tmp_path: Path) -> None:
    path = write1(tmp_path / "a.bag")
    digest = make_typestore(1, {}).generate_msgdef(TEXT)[1].encode()
    path.write_bytes(path.read_bytes().replace(digest, b"0" * 32))
    assert "/text differs from the known std_msgs/msg/String" in refusal(path)


def test_topics_whose_yaml_grows_exponentially_are_refused(tmp_path: Path) -> None:
    path = write2(tmp_path / "a", "SQLITE3") / "a.db3"
    lines = ["- a0: &a0 {k: 1}"] + [
        f"  a{k}: &a{k} {{<<: [*a{k - 1}, *a{k - 1}]}}" for k in range(1, 40)
    ]
    with sqlite3.connect(path) as database:
        database.execute("UPDATE topics SET offered_qos_profiles = ?", ("\n".join(lines),))
    assert "merge keys" in refusal(path)


@pytest.mark.parametrize("data", [b"", b"#ROSBAG", b"\0" * 1000, b"#ROSBAG V2.0\n" + b"\xff" * 50])
def test_what_is_no_bag_is_refused(data: bytes, tmp_path: Path) -> None:
    for name in ("a.bag", "a.mcap", "a.db3"):
        (tmp_path / name).write_bytes(data)
        assert "cannot be opened" in refusal(tmp_path / name)
