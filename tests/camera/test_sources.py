"""Finding the source from a path or a name."""

from pathlib import Path

import numpy as np
import pytest

from common.io.recording import RecordingWriter, open_recording
from people4d.errors import SourceError
from people4d.messages import CompressedRgbdFrame, Odometry, RgbdFrame
from services.camera.config import CameraConfig
from services.camera.node import CameraNode
from services.camera.recording import DEPTH_SENSORS, RecordingSource
from services.camera.ros.source import RosbagSource
from services.camera.source import SourceFrame
from services.camera.sources import SOURCES, kind_of, open_source
from tests.camera.memory import SIZE, MemorySource, capture, odometry
from tests.camera.ros.bags import Ros, frames


class Plugin(MemorySource):
    def __init__(self, count: int = 1) -> None:
        if count < 0:
            raise OSError("no device")
        super().__init__([capture(k) for k in range(count)], live=True)


class Uncalibrated(Plugin):
    def __init__(self) -> None:
        super().__init__()
        del self.info


def recorded(path: Path, cameras: tuple[str, ...] = ("front",)) -> Path:
    """Three frames, odometry before each, and calibration, by camera."""
    with RecordingWriter(path) as writer:
        for camera in cameras:
            node = CameraNode(CameraConfig(camera=camera), MemorySource([]))
            for message in node.tick(0):
                writer.write(message, 1)
            node.close()
        for k in range(3):
            writer.write(odometry(10 * k), 2 + k)
            for camera in cameras:
                frame = RgbdFrame(
                    stamp_ns=10_000_000 * k,
                    sequence=k,
                    camera=camera,
                    rgb=np.full((*SIZE, 3), 90, np.uint8),
                    depth_mm=np.full(SIZE, 500 + k, np.uint16),
                )
                writer.write(frame, 2 + k)
    return path


def test_recording_gives_frames_calibration_and_odometry(tmp_path: Path) -> None:
    source = open_source(str(recorded(tmp_path / "a.mcap")))
    assert isinstance(source, RecordingSource)
    assert (source.info.camera, source.info.frame_id) == ("front", "front_optical_frame")
    assert [t.child for t in source.transforms] == ["front_optical_frame"]
    items = list(source)
    assert [type(item) for item in items] == [Odometry, SourceFrame] * 3
    last = items[-1]
    assert isinstance(last, SourceFrame)
    assert (last.stamp_ns, int(last.depth_mm[0, 0])) == (20_000_000, 502)
    assert abs(int(last.rgb[0, 0, 0]) - 90) < 4  # JPEG


def test_recording_cut_short_plays_up_to_the_cut(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap")
    data = path.read_bytes()
    path.write_bytes(data[: data.rindex(b"CompressedRgbdFrame") + 100])
    source = open_source(str(path))
    assert sum(isinstance(item, SourceFrame) for item in source) == 2
    assert source.counters["cut_short"] == 1


def test_recording_of_two_cameras_needs_a_name(tmp_path: Path) -> None:
    path = str(recorded(tmp_path / "a.mcap", ("left", "right")))
    with pytest.raises(SourceError, match=r"got left, right. Set options.camera"):
        open_source(path)
    source = open_source(path, options={"camera": "right"})
    assert source.info.camera == "right"
    assert sum(isinstance(item, SourceFrame) for item in source) == 3


def test_recording_without_calibration_is_refused(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        writer.write(odometry(0), 0)
    with pytest.raises(SourceError, match="got none"):
        open_source(str(tmp_path / "a.mcap"))


def test_damaged_frame_in_a_recording_is_counted(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap")
    with RecordingWriter(tmp_path / "b.mcap") as writer:
        for time_ns, message in open_recording(path).messages():
            if isinstance(message, CompressedRgbdFrame) and message.sequence == 1:
                message = CompressedRgbdFrame(
                    stamp_ns=message.stamp_ns,
                    sequence=1,
                    camera="front",
                    rgb_jpeg=message.rgb_jpeg[:40],
                    depth_png=message.depth_png,
                )
            writer.write(message, time_ns)
    source = open_source(str(tmp_path / "b.mcap"))
    assert sum(isinstance(item, SourceFrame) for item in source) == 2
    assert source.counters["bad_images"] == 1


def test_kind_follows_from_the_path(tmp_path: Path) -> None:
    ros2 = Ros(2)
    folder = ros2.write(tmp_path / "ros2_mcap", frames(ros2))
    ros1 = Ros(1)
    assert kind_of(str(folder)) == "rosbag"
    assert kind_of(str(next(folder.glob("*.mcap")))) == "rosbag"
    assert kind_of(str(ros1.write(tmp_path / "a.bag", frames(ros1)))) == "rosbag"
    assert kind_of(str(recorded(tmp_path / "a.mcap"))) == "recording"
    assert kind_of(str(tmp_path)) == "folder"
    assert kind_of("package.module:Class") == "plugin"
    assert isinstance(open_source(str(folder)), RosbagSource)
    assert kind_of("lab:two_easy") == "lab"
    assert kind_of("ros2+dds:/camera") == "ros2"
    assert set(SOURCES) == {"recording", "rosbag", "folder", "lab", "ros2"}


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.mcap", b"", "not an MCAP file"),
        ("a.mcap", b"\x89MCAP0\r\n\x01", "not an MCAP file"),
        ("a.mcap", b"\x89MCAP0\r\n\x01" + bytes(100), "is not a recording"),
        ("a.bag", b"junk", "cannot be opened"),
        ("a.db3", b"junk", "cannot be opened"),
        ("a.mp4", b"junk", "is not a known kind of recording"),
    ],
)
def test_junk_is_refused_in_one_sentence(
    tmp_path: Path, name: str, data: bytes, message: str
) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(SourceError, match=message):
        open_source(str(tmp_path / name))


def test_nothing_there() -> None:
    for source in ("", "no/such/path", "C:/x.bag"):
        with pytest.raises(SourceError, match="does not exist"):
            open_source(source)


def test_plugin_gets_its_options() -> None:
    name = f"{__name__}:Plugin"
    assert len(list(open_source(name, options={"count": 3}))) == 3
    with pytest.raises(SourceError, match=r"cannot be opened.*no device"):
        open_source(name, options={"count": -1})
    with pytest.raises(SourceError, match="unexpected keyword argument 'size'"):
        open_source(name, options={"size": 3})
    with pytest.raises(SourceError, match="cannot be loaded"):
        open_source("no_such_module:Camera")
    with pytest.raises(SourceError, match="cannot be loaded"):
        open_source(f"{__name__}:NoSuchClass")
    with pytest.raises(SourceError, match=r"info is NoneType, expected CameraInfo"):
        open_source(f"{__name__}:Uncalibrated")
    with pytest.raises(SourceError, match=r"is not a services.camera.source.Source"):
        open_source("builtins:dict")


def test_absent_lab_is_reported_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        writer.write_metadata("lab", {"depth": "clean"})
        for _, message in open_recording(recorded(tmp_path / "b.mcap")).messages():
            writer.write(message, 1)
    monkeypatch.setitem(DEPTH_SENSORS, "lab", "absent.lab:depth_sensor_of")
    with pytest.raises(SourceError, match=r"No module named 'absent'.*options.depth_sensor=off"):
        open_source(str(path))
    open_source(str(path), options={"depth_sensor": "off"})


@pytest.mark.parametrize(
    ("name", "remedy"), [("a.bag.active", "rosbag reindex"), ("a.mcap.zstd", "zstd -d")]
)
def test_file_of_a_killed_recorder_or_a_tool_is_refused_with_a_remedy(
    tmp_path: Path, name: str, remedy: str
) -> None:
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(SourceError, match=remedy):
        kind_of(str(tmp_path / name))
