"""Descriptions of recordings, bags and folders."""

from pathlib import Path

import numpy as np
import pytest

from common.io.recording import RecordingWriter
from people4d.errors import SourceError
from services.camera.calibration import Intrinsics, camera_info
from services.camera.describe import describe
from tests.camera.folder.test_folder import numbered
from tests.camera.memory import SIZE
from tests.camera.ros.bags import COLOUR, DEPTH, INFO, Ros, frames
from tests.camera.test_sources import recorded


def test_bag(tmp_path: Path) -> None:
    ros = Ros(1)
    found = describe(ros.write(tmp_path / "a.bag", frames(ros)))
    assert (found.kind, found.frames, found.problem) == ("rosbag", 3, "")
    assert [(t.name, t.count) for t in found.topics] == [(DEPTH, 3), (INFO, 1), (COLOUR, 3)]
    assert found.duration_s == pytest.approx(0.204, abs=1e-6)  # last depth 204 ms after the first
    assert found.calibration is not None
    assert (found.calibration.width, found.registered, found.mounted_in) == (8, False, "")


def test_bag_without_depth_is_still_described(tmp_path: Path) -> None:
    ros = Ros(2)
    entries = [entry for entry in frames(ros) if entry[0] != DEPTH]
    found = describe(ros.write(tmp_path / "a_mcap", entries))
    assert [t.name for t in found.topics] == [INFO, COLOUR]
    assert found.problem.startswith("bag has no depth images")


def test_recording(tmp_path: Path) -> None:
    found = describe(recorded(tmp_path / "a.mcap"))
    assert (found.kind, found.frames, found.has_odometry) == ("recording", 3, True)
    assert [(t.type, t.count) for t in found.topics] == [
        ("CameraInfo", 1),
        ("Odometry", 3),
        ("CompressedRgbdFrame", 3),
        ("StaticTransform", 1),
    ]
    assert (found.mounted_in, found.has_truth) == ("map", False)


def test_folder(tmp_path: Path) -> None:
    found = describe(numbered(tmp_path))
    assert (found.kind, found.frames) == ("folder", 3)
    assert found.duration_s == pytest.approx(2 / 30, abs=1e-6)


def test_junk_never_crashes(tmp_path: Path) -> None:
    generator = np.random.default_rng(3)
    for name in ("a.bag", "a.mcap", "a.db3", "a.txt"):
        for head in (b"", b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\x00"):
            (tmp_path / name).write_bytes(head + generator.bytes(500))
            with pytest.raises(SourceError):
                describe(tmp_path / name)
    with pytest.raises(SourceError, match="does not exist"):
        describe(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    assert "no numbered pairs" in describe(tmp_path / "empty").problem


def test_lab(shared: Path) -> None:
    found = describe(shared / "data/lab/two")
    assert (found.frames, found.mounted_in, found.has_truth) == (150, "map", True)
    assert found.duration_s == pytest.approx(149 / 30, abs=1e-3)


def test_recording_that_is_cut_short(tmp_path: Path) -> None:
    file = recorded(tmp_path / "a.mcap")
    assert not describe(file).cut_short
    data = file.read_bytes()
    file.write_bytes(data[: data.rindex(b"CompressedRgbdFrame") + 100])
    assert describe(file).cut_short


def test_recording_without_frames_is_described_as_such(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        writer.write(camera_info(Intrinsics(fx=10, fy=10, cx=4, cy=3), SIZE), 0)
    found = describe(path)
    assert (found.frames, found.problem) == (0, "it has no frames")
