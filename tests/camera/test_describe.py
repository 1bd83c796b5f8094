"""Descriptions of recordings, bags and folders."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from common.io.recording import RecordingWriter
from deploy.cli.data.info import Info, camera_text, odometry_text
from people4d.errors import SourceError
from services.camera.calibration import Intrinsics, camera_info
from services.camera.describe import Description, describe
from tests import builders
from tests.builders import rgbd_frame
from tests.camera.folder.test_folder import numbered
from tests.camera.memory import SIZE
from tests.camera.ros.bags import COLOUR, DEPTH, FRAME, INFO, ODOMETRY, TF, Ros, frames
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


def test_frames_that_never_pair_are_a_problem(tmp_path: Path) -> None:
    # Depth is a minute later than colour: 30 images of each, and no frame.
    ros = Ros(2)
    found = describe(ros.write(tmp_path / "a_mcap", frames(ros, shift_ns=60 * 10**9)))
    assert found.problem == "no frame of it can be played (unpaired 6)"


def test_images_of_another_size_than_the_calibration_are_a_problem(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        writer.write(camera_info(Intrinsics(fx=10, fy=10, cx=4, cy=3), (12, 16)), 0)
        rgb, depth_mm = np.zeros((6, 8, 3), np.uint8), np.zeros((6, 8), np.uint16)
        writer.write(rgbd_frame(camera="camera", stamp_ns=1, rgb=rgb, depth_mm=depth_mm), 1)
    assert "expected uint8 (12, 16, 3) red first (wrong_size 1)" in describe(path).problem


def test_odometry_that_nothing_links_to_the_map_is_named(tmp_path: Path) -> None:
    ros = Ros(2)
    odometry = (ODOMETRY, 1, ros.odometry(3, 4, 0.5, 999_000_000))
    still = ros.transform("base_link", FRAME, (1, 0, 0), (-0.5, 0.5, -0.5, 0.5))
    mount = (TF, 1, still)
    found = describe(ros.write(tmp_path / "a_mcap", [mount, odometry, *frames(ros)]))
    assert (found.mounted_in, found.unlinked_odometry, found.turned_deg) == ("base_link", "odom", 0)
    assert "--set tracker.frame_id=odom" in odometry_text(found)
    in_map = Info(**msgspec.structs.asdict(found) | {"mounted_in": "map"})
    assert odometry_text(in_map).startswith(
        "yes, in odom, unused: the camera is mounted in the map"
    )


def test_camera_upside_down_is_described_as_turned(tmp_path: Path) -> None:
    # The optical frame of an upright camera, rolled by half a turn about its axis.
    ros = Ros(2)
    hangs = ros.transform("map", FRAME, (0, 0, 2), (0.5, 0.5, 0.5, 0.5))
    entries = [(TF, 1, hangs), *frames(ros)]
    found = describe(ros.write(tmp_path / "a_mcap", entries))
    assert found.turned_deg == 180
    assert "turned by 180 degrees" in camera_text(found)


def test_calibration_of_another_image_size_is_named() -> None:
    halved = builders.camera_info(cx=160.0, cy=120.0)
    found = Description(path="x", kind="folder", calibration=halved)
    assert "160, 120 is far from the centre of 640x480" in camera_text(found)
