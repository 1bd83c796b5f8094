"""Clean depth in a recording, and the sensor's errors during playback."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from common.io.images import decompress
from common.io.recording import RecordingWriter, open_recording
from deploy.cli import app
from deploy.cli.data.info import read_info
from deploy.cli.data.replay import clean_cameras, frame_of
from lab.depth.config import DepthSensorModel
from lab.depth.metadata import SimulationMetadata, read_metadata
from lab.depth.sensor import DepthSensor
from people4d.errors import ConfigError, SourceError
from people4d.messages import U16, CompressedRgbdFrame, RgbdFrame
from services.camera.describe import describe
from services.camera.source import SourceFrame
from services.camera.sources import open_source
from tests import builders

SENSOR = DepthSensorModel(noise_px=0.1, holes=0.02)
METADATA = SimulationMetadata(scenario="crossing", seed=4, depth="clean", sensor=SENSOR)
INFO = builders.camera_info(width=80, height=60, fx=77.0, cx=39.5, cy=29.5)


def clean(frame: int) -> U16:
    depth_mm = np.full((60, 80), 4000, np.uint16)
    depth_mm[20:50, 30 + frame : 50 + frame] = 2000
    depth_mm[:5] = 0
    return depth_mm


def recorded(path: Path, values: Mapping[str, str] | None, shape: Any = (60, 80)) -> Path:
    with RecordingWriter(path) as writer:
        if values is not None:
            writer.write_metadata("lab", values)
        writer.write(INFO, 0)
        for k in range(4):
            frame = RgbdFrame(
                stamp_ns=10**9 + k * 33_333_333,
                sequence=k,
                camera="front",
                rgb=np.full((*shape, 3), 90, np.uint8),
                depth_mm=clean(k)[: shape[0], : shape[1]],
            )
            writer.write(frame, frame.stamp_ns)
    return path


def depths(path: Path, **options: Any) -> list[U16]:
    source = open_source(str(path), options=options)
    return [item.depth_mm for item in source if isinstance(item, SourceFrame)]


def expected(frame: int, config: DepthSensorModel = SENSOR) -> U16:
    stamp_s = (10**9 + frame * 33_333_333) / 1e9
    depth_m = clean(frame).astype(np.float32) / np.float32(1000)
    return DepthSensor(config, INFO, 4).measure(depth_m, None, stamp_s)


def test_camera_reads_clean_depth_as_its_sensor_would(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap", METADATA.texts())
    read = depths(path)
    assert len(read) == 4
    for k, depth_mm in enumerate(read):
        assert np.array_equal(depth_mm, expected(k))
        assert not np.array_equal(depth_mm, clean(k))
        assert not depth_mm[0].any()
    assert all(map(np.array_equal, depths(path, depth_sensor="off"), map(clean, range(4))))


def test_errors_can_be_changed(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap", METADATA.texts())
    changed = msgspec.structs.replace(SENSOR, noise_px=0.0, max_depth_m=3.0)
    read = depths(path, sensor={"noise_px": 0, "max_depth_m": 3})
    assert np.array_equal(read[2], expected(2, changed))
    with pytest.raises(ConfigError, match="noise_px"):
        depths(path, sensor={"noise_px": -1})
    with pytest.raises(ConfigError, match="unknown field `noise`"):
        depths(path, sensor={"noise": 1})


def test_measured_depth_and_foreign_recordings_stay_as_they_are(tmp_path: Path) -> None:
    measured = msgspec.structs.replace(METADATA, depth="measured")
    for name, values in {"a": measured.texts(), "b": None}.items():
        path = recorded(tmp_path / f"{name}.mcap", values)
        assert all(map(np.array_equal, depths(path), map(clean, range(4))))
        assert clean_cameras(open_recording(path)) == {}


def test_replay_gives_the_same_with_pixels_and_compressed(tmp_path: Path) -> None:
    recording = open_recording(recorded(tmp_path / "a.mcap", METADATA.texts()))
    cameras = clean_cameras(recording)
    frames = [m for _, m in recording.messages(CompressedRgbdFrame)]
    assert len(frames) == 4
    for k, message in reversed(list(enumerate(frames))):
        assert isinstance(message, CompressedRgbdFrame)
        with_pixels = frame_of(message, cameras["front"], pixels=True)
        compressed = frame_of(message, cameras["front"], pixels=False)
        assert isinstance(with_pixels, RgbdFrame)
        assert isinstance(compressed, CompressedRgbdFrame)
        assert np.array_equal(with_pixels.depth_mm, expected(k))
        assert np.array_equal(decompress(compressed).depth_mm, expected(k))
        assert compressed.rgb_jpeg == message.rgb_jpeg
        assert frame_of(message, None, pixels=False) is message


def test_info_shows_the_simulation(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap", METADATA.texts())
    assert read_info(path).lab == METADATA
    error = CliRunner().invoke(app, ["info", str(path)]).stdout
    assert "scenario crossing, seed 4; depth stored clean" in error
    as_json = json.loads(CliRunner().invoke(app, ["info", "--json", str(path)]).stdout)
    assert as_json["lab"]["sensor"]["noise_px"] == 0.1
    assert read_info(recorded(tmp_path / "b.mcap", None)).lab is None


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"depth": "raw"}, "Invalid enum value 'raw'"),
        ({"sensor": "{"}, "truncated"),
        ({"sensor": '{"noise_px": -1}'}, "noise_px"),
        ({"sensor": '{"later": 1}'}, "unknown field `later`"),
        ({"seed": "x"}, "Expected `int`"),
        ({"seed": "-1"}, "Expected `int` >= 0"),
        ({"scenario": None}, "missing required field `scenario`"),
    ],
)
def test_damaged_metadata_is_refused_in_one_sentence(
    tmp_path: Path, changes: dict[str, str | None], error: str
) -> None:
    values = {**METADATA.texts(), **changes}
    path = recorded(
        tmp_path / "a.mcap", {name: value for name, value in values.items() if value is not None}
    )
    with pytest.raises(SourceError, match=error):
        depths(path)
    with pytest.raises(SourceError, match=error):
        read_metadata(open_recording(path))
    assert "metadata of the virtual lab" in describe(path).problem
    assert len(depths(path, depth_sensor="off")) == 4


def test_frame_of_another_size_is_left_out(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap", METADATA.texts(), shape=(50, 80))
    source = open_source(str(path))
    assert [item for item in source if isinstance(item, SourceFrame)] == []
    assert source.counters["bad_images"] == 4
