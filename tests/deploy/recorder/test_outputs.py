"""Recorders: parts stay within a limit, events bring the seconds before them."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from common.io.recording import RecordingWriter, open_recording
from deploy.recorder.conditions import PERSON, Condition
from deploy.recorder.outputs import EventFiles, RotatingParts
from people4d.errors import ConfigError, SourceError
from people4d.messages import Message, Odometry, Tracks, Truth
from tests import builders

S = 10**9


def odometry(tenth: int) -> Odometry:
    return builders.odometry(stamp_ns=tenth * S // 10, sequence=tenth)


def entering(*ids: int, tenth: int = 0) -> Tracks:
    return builders.tracks(*(builders.track(id=k) for k in ids), stamp_ns=tenth * S // 10)


def content(path: Path) -> list[Message]:
    return [message for _, message in open_recording(path).messages()]


def sequences(path: Path) -> list[int]:
    return [m.sequence for m in content(path) if isinstance(m, Odometry)]


def test_parts_stay_within_the_limit_and_begin_with_calibration(tmp_path: Path) -> None:
    output = RotatingParts(tmp_path / "x.mcap", 0.05, RecordingWriter)
    output.write(builders.static_transform(np.eye(4)), 0)
    for tenth in range(2000):
        output.write(odometry(tenth), tenth * S // 10)
    output.close()
    parts = sorted(tmp_path.glob("x-*.mcap"))
    assert len(parts) == 10
    assert sum(part.stat().st_size for part in parts) < 1.1 * 0.05e6
    assert all(type(content(part)[0]).__name__ == "StaticTransform" for part in parts)
    recorded = [k for part in parts for k in sequences(part)]
    assert recorded == list(range(recorded[0], 2000))  # without a gap from part to part
    deleted = int(parts[-1].stem.rpartition("-")[2]) - 10
    assert (
        output.summary()
        == f"{deleted} of {deleted + 10} parts were deleted to stay within the limit."
    )


def test_an_event_writes_the_seconds_before_and_after_it(tmp_path: Path) -> None:
    output = EventFiles(tmp_path / "x.mcap", 2.0, Condition(PERSON), 1.0, RecordingWriter)
    output.write(builders.static_transform(np.eye(4)), 0)
    for tenth in range(200):
        output.write(odometry(tenth), tenth * S // 10)
        if tenth in (50, 60, 150):  # 60: within the two seconds after 50
            output.write(entering(tenth), tenth * S // 10)
    output.close()
    assert [p.name for p in sorted(tmp_path.iterdir())] == ["x-0001.mcap", "x-0002.mcap"]
    assert sequences(tmp_path / "x-0001.mcap") == list(range(30, 81))
    assert sequences(tmp_path / "x-0002.mcap") == list(range(130, 171))
    assert type(content(tmp_path / "x-0002.mcap")[0]).__name__ == "StaticTransform"
    assert output.summary() == "2 files of events."


def test_a_buffer_that_is_too_small_is_counted(tmp_path: Path) -> None:
    output = EventFiles(tmp_path / "x.mcap", 60.0, Condition(PERSON), 0.002, RecordingWriter)
    for tenth in range(100):
        output.write(odometry(tenth), tenth * S // 10)
    output.write(entering(1), 10 * S)
    output.close()
    written = len(sequences(tmp_path / "x-0001.mcap"))
    assert 0 < written < 100
    assert output.summary() == (
        f"1 file of events; {100 - written} messages before them exceeded the buffer."
    )


def test_a_person_enters_once() -> None:
    condition = Condition(PERSON)
    assert not condition.is_met(builders.tracks(builders.track(state="tentative")))
    assert [condition.is_met(m) for m in (entering(1), entering(1), entering(1, 2))] == [
        True,
        False,
        True,
    ]


def test_conditions_are_named() -> None:
    assert Condition("truth").message is Truth
    with pytest.raises(ConfigError, match="unknown condition 'fire'"):
        Condition("fire")


def test_a_full_disk_ends_with_an_error_and_the_parts_before_remain(tmp_path: Path) -> None:
    opened: list[Path] = []

    def open_part(path: Path) -> RecordingWriter:
        opened.append(path)
        return RecordingWriter(path if len(opened) < 3 else Path("/dev/full"))

    output = RotatingParts(tmp_path / "x.mcap", 0.05, open_part)

    def write_all() -> None:
        for tenth in range(2000):
            output.write(odometry(tenth), tenth * S // 10)

    with pytest.raises(SourceError, match="No space left"):
        write_all()
    output.close()
    assert all(sequences(path) for path in opened[:2])


def test_quality_is_passed_on(tmp_path: Path) -> None:
    rgb = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    frame = builders.rgbd_frame(rgb=rgb, depth_mm=np.zeros((48, 64), np.uint16))
    sizes = []
    for quality in (20, 90):
        output = RotatingParts(
            tmp_path / f"{quality}.mcap", 1.0, partial(RecordingWriter, quality=quality)
        )
        output.write(frame, 0)
        output.close()
        sizes.append((tmp_path / f"{quality}-0001.mcap").stat().st_size)
    assert sizes[0] < sizes[1]
