"""Recordings: messages are read as written and in order, also from damaged files."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from common.io.images import decompress
from common.io.recording import RecordingWriter, open_recording
from people4d.codec import MAX_BYTES, encode
from people4d.errors import SourceError
from people4d.messages import (
    CompressedRgbdFrame,
    Message,
    Odometry,
    RgbdFrame,
    StaticTransform,
    Truth,
)
from tests import ROOT, builders

S = 10**9
DEMO = ROOT / "deploy/demo/crossing.mcap"


def odometry(second: int) -> Odometry:
    return builders.odometry(stamp_ns=second * S, sequence=second, x_m=float(second))


def transform() -> StaticTransform:
    return builders.static_transform(np.eye(4), child="cam")


def write(path: Path, *messages: tuple[int, Message]) -> Path:
    with RecordingWriter(path) as writer:
        for log_time_ns, message in messages:
            writer.write(message, log_time_ns)
    return path


def seconds(path: Path) -> list[float]:
    return [t / S for t, _ in open_recording(path).messages(Odometry)]


def write_mcap(
    path: Path,
    payloads: list[bytes],
    profile: str = "people4d",
    compression: CompressionType = CompressionType.NONE,
) -> Path:
    """A chunked file, the form of other MCAP tools."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, chunk_size=200)
        writer.start(profile, "another tool")
        channel = writer.register_channel("odometry", "msgpack", 0)
        for k, payload in enumerate(payloads):
            writer.add_message(channel, k * S, payload, k * S)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def test_metadata_is_read_back(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        writer.write_metadata("lab", {"seed": "1"})
        writer.write(odometry(1), S)
        writer.write_metadata("lab", {"seed": "2", "größe": ""})
        writer.write_metadata("room", {})
    recording = open_recording(tmp_path / "x.mcap")
    assert recording.metadata == {"lab": {"seed": "2", "größe": ""}, "room": {}}
    assert (len(list(recording.messages())), recording.summary.truncated) == (1, False)


def test_too_many_metadata_records_are_refused(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "x.mcap") as writer:
        for k in range(257):
            writer.write_metadata(str(k), {})
    with pytest.raises(SourceError, match="more than 256 metadata records"):
        open_recording(tmp_path / "x.mcap")


def test_messages_come_back_by_log_time(tmp_path: Path) -> None:
    path = write(
        tmp_path / "sub/x.mcap", (3 * S, odometry(3)), (1 * S, transform()), (2 * S, odometry(2))
    )
    recording = open_recording(path)
    got = list(recording.messages())
    assert [t for t, _ in got] == [S, 2 * S, 3 * S]
    assert isinstance(got[0][1], StaticTransform)
    assert got[2][1] == odometry(3)
    assert recording.bad_messages == 0
    summary = recording.summary
    assert summary.topics == {"odometry": 2, "transforms/cam": 1}
    assert (summary.start_ns, summary.duration_s, summary.truncated) == (S, 2.0, False)


def test_seek_begins_with_the_latched_messages_before(tmp_path: Path) -> None:
    late = builders.static_transform(np.eye(4), child="late")
    path = write(
        tmp_path / "x.mcap",
        *((k * S, transform()) for k in (0, 1)),
        *((k * S, odometry(k)) for k in (2, 3, 4, 5)),
        (6 * S, late),
    )
    recording = open_recording(path)
    got = [(t / S, type(m)) for t, m in recording.messages(start_s=3.0, end_s=4.0)]
    assert got == [(3.0, StaticTransform), (3.0, Odometry), (4.0, Odometry)]
    assert len(list(recording.messages())) == 7


def test_topics_of_other_programs_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start("people4d", "another tool")
        schema = writer.register_schema("foxglove.Log", "protobuf", b"")
        other = writer.register_channel("/log", "protobuf", schema)
        own = writer.register_channel("odometry", "msgpack", 0)
        writer.add_message(other, 0, b"12", 0)
        writer.add_message(own, S, encode(odometry(1)), S)
        writer.finish()  # type: ignore[no-untyped-call]
    recording = open_recording(path)
    assert [type(m) for _, m in recording.messages()] == [Odometry]
    assert recording.bad_messages == 0
    assert recording.summary.encodings == {"/log": "protobuf", "odometry": "msgpack"}


def test_only_the_types_asked_for(tmp_path: Path) -> None:
    path = write(tmp_path / "x.mcap", (1, transform()), (2, odometry(2)))
    recording = open_recording(path)
    assert [type(m) for _, m in recording.messages(StaticTransform)] == [StaticTransform]
    assert len(list(recording.messages(StaticTransform, Odometry))) == 2
    assert list(recording.messages(Truth)) == []


def test_equal_log_times_keep_their_order(tmp_path: Path) -> None:
    path = write(tmp_path / "x.mcap", *((5, odometry(k)) for k in range(4)))
    assert [m.sequence for _, m in open_recording(path).messages()] == [0, 1, 2, 3]


def test_frames_are_stored_compressed_and_depth_is_exact(tmp_path: Path) -> None:
    depth_mm = np.arange(48 * 64, dtype=np.uint16).reshape(48, 64) * 20
    rgb = np.full((48, 64, 3), (200, 100, 50), np.uint8)
    frame = RgbdFrame(stamp_ns=9, sequence=4, camera="front", rgb=rgb, depth_mm=depth_mm)
    recording = open_recording(write(tmp_path / "x.mcap", (9, frame)))
    assert recording.summary.topics == {"raw/front/compressed": 1}
    ((_, message),) = recording.messages(CompressedRgbdFrame)
    assert isinstance(message, CompressedRgbdFrame)
    got = decompress(message)
    np.testing.assert_array_equal(got.depth_mm, depth_mm)
    assert np.abs(got.rgb.astype(int) - rgb).max() <= 4


def test_other_mcap_tools_read_it(tmp_path: Path) -> None:
    path = write(tmp_path / "x.mcap", (3 * S, odometry(1)))
    with path.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "people4d"
        ((_, channel, message),) = reader.iter_messages()
    assert (channel.topic, channel.message_encoding) == ("odometry", "msgpack")
    assert (message.log_time, message.publish_time, message.sequence) == (3 * S, S, 1)
    assert message.data == encode(odometry(1))


def test_a_file_with_chunks_is_read(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "x.mcap", [encode(odometry(k)) for k in range(10)])
    assert seconds(path) == list(range(10))


@pytest.mark.slow
def test_every_cut_is_readable_up_to_the_cut(tmp_path: Path) -> None:
    path = write(tmp_path / "x.mcap", *((k * S, odometry(k)) for k in range(5)))
    data = path.read_bytes()
    size = len(encode(odometry(3)))  # the fourth message, whose bytes lie between 3 and 4
    counts = []
    for length in range(len(data)):
        path.write_bytes(data[:length])
        try:
            counts.append(len(seconds(path)))
        except SourceError:
            counts.append(-1)  # cut inside magic or header: nothing to read
    assert counts == sorted(counts)  # a longer part of the file holds at least as many messages
    assert set(counts) == {-1, 0, 1, 2, 3, 4, 5}
    assert counts.count(3) == size + 9 + 22  # record header 9 bytes, message header 22


def test_a_recorder_that_was_killed_leaves_a_readable_file(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "x.mcap")
    for k in range(200):
        writer.write(odometry(k), k * S)
    copy = tmp_path / "copy.mcap"
    copy.write_bytes((tmp_path / "x.mcap").read_bytes())  # what is on disk before close
    writer.close()
    recording = open_recording(copy)
    assert recording.summary.truncated
    got = [m.sequence for _, m in recording.messages()]
    assert len(got) > 100
    assert got == list(range(len(got)))


@pytest.mark.parametrize("tail", [b"\0" * 1000, b"\x05" + b"\xff" * 500])
def test_junk_at_the_end_ends_the_recording(tail: bytes, tmp_path: Path) -> None:
    path = write(tmp_path / "x.mcap", (0, odometry(0)), (S, odometry(1)))
    data = path.read_bytes()
    end = data.rindex(encode(odometry(1))) + len(encode(odometry(1)))
    path.write_bytes(data[:end] + tail)
    assert seconds(path) == [0, 1]
    assert open_recording(path).summary.truncated


def test_messages_that_do_not_decode_are_counted(tmp_path: Path) -> None:
    payloads = [encode(odometry(0)), b"junk", b"", encode(transform()), encode(odometry(4))]
    recording = open_recording(write_mcap(tmp_path / "x.mcap", payloads))
    assert [t // S for t, _ in recording.messages(Odometry)] == [0, 4]
    assert recording.bad_messages == 3  # a transform does not belong on this topic


def test_a_huge_message_is_skipped_unread(tmp_path: Path) -> None:
    path = write(tmp_path / "x.mcap", (0, odometry(0)))
    data = path.read_bytes()
    at = data.index(encode(odometry(0))) - 22 - 9  # start of the message record
    size = MAX_BYTES + 1
    with path.open("r+b") as file:
        file.seek(at)
        file.write(struct.pack("<BQ", 5, size + 22))
        file.truncate(at + 9 + 22 + size)  # a sparse file: no bytes on disk
    recording = open_recording(path)
    assert list(recording.messages()) == []
    assert recording.bad_messages == 1


def write_junk(path: Path) -> None:
    path.write_bytes(np.random.default_rng(0).bytes(1000))


def write_empty(path: Path) -> None:
    path.write_bytes(b"")


def write_huge_header(path: Path) -> None:
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 1, 2**40))


def write_ros(path: Path) -> None:
    write_mcap(path, [], profile="ros2")


def write_packed(path: Path) -> None:
    write_mcap(path, [encode(odometry(0))], compression=CompressionType.LZ4)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (write_junk, "has no MCAP signature. Check the path."),
        (write_empty, "has no MCAP signature"),
        (write_huge_header, "is truncated before its header"),
        (write_ros, "of profile 'ros2', not of 'people4d'. Open a ROS 2 recording as a ROS bag."),
        (write_packed, "chunks are compressed. Rewrite it with"),
    ],
)
def test_other_files_are_refused(
    make: Callable[[Path], None], message: str, tmp_path: Path
) -> None:
    make(tmp_path / "x.mcap")
    with pytest.raises(SourceError, match=message):
        open_recording(tmp_path / "x.mcap")


def test_random_damage_never_breaks_the_reader(tmp_path: Path) -> None:
    path = write(tmp_path / "x.mcap", *((k * S, odometry(k)) for k in range(5)))
    data = path.read_bytes()
    random = np.random.default_rng(1)
    for _ in range(300):
        damaged = bytearray(data)
        damaged[random.integers(len(data))] = random.integers(256)
        path.write_bytes(bytes(damaged))
        try:
            assert len(list(open_recording(path).messages())) <= 5
        except SourceError:
            continue


def test_paths_that_cannot_be_used(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="cannot be read: No such file"):
        open_recording(tmp_path / "none.mcap")
    with pytest.raises(SourceError, match="cannot be written: Is a directory"):
        RecordingWriter(tmp_path)


def test_the_demo_recording() -> None:
    recording = open_recording(DEMO)
    assert recording.summary.topics == {
        "camera/front/info": 1,
        "raw/front/compressed": 135,
        "transforms/front_optical_frame": 1,
        "truth": 901,
    }
    assert recording.metadata["lab"]["depth"] == "clean"
    assert DEMO.stat().st_size <= 16_000_000
    frames = [m.stamp_ns for _, m in recording.messages(CompressedRgbdFrame)]
    truth = [m.stamp_ns for _, m in recording.messages(Truth)]
    assert truth[0] <= frames[0]
    assert frames[-1] <= truth[-1]
    assert np.allclose(np.diff(truth) / S, 1 / 100, atol=1e-6)
    assert np.allclose(np.diff(frames) / S, 1 / 15, atol=1e-6)
    assert recording.bad_messages == 0


def test_full_disk_is_reported_in_one_sentence() -> None:
    writer = RecordingWriter(Path("/dev/full"))
    with pytest.raises(SourceError, match="recording /dev/full cannot be written: No space left"):
        write_all(writer, 10_000)  # more than any buffer holds
    writer.close()  # the error is raised once


def write_all(writer: RecordingWriter, count: int) -> None:
    for k in range(count):
        writer.write(odometry(k), k)
