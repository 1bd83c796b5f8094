"""The virtual lab as a camera."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lab.camera.frames import FrameRenderer
from lab.drawing.renderer import DepthView
from lab.source import LabSource
from people4d.errors import ConfigError
from people4d.messages import Odometry
from services.camera.config import CameraConfig
from services.camera.playback import play as play_source
from services.camera.source import SourceFrame
from services.camera.sources import kind_of, open_source
from tests.lab.scenarios import DRIVE, EPOCH_NS, FRAMES, SIZE, write_scenario

pytestmark = [pytest.mark.processes, pytest.mark.render]

S = 10**9


def opened(path: Path, seed: str = "", **options: object) -> LabSource:
    source = open_source(f"lab:{path}{seed}", options={"mode": "depth", "threads": 1, **options})
    assert isinstance(source, LabSource)
    return source


def captures(source: LabSource) -> list[SourceFrame]:
    return [item for item in source if isinstance(item, SourceFrame)]


def test_still_camera_gives_its_frames_and_its_pose(tmp_path: Path) -> None:
    source = opened(write_scenario(tmp_path))
    found = list(source)
    assert len(found) == FRAMES
    assert [item.stamp_ns for item in found] == [EPOCH_NS + k * S // 10 for k in range(FRAMES)]
    assert not source.live
    (position,) = source.transforms
    assert (position.parent, position.child) == ("map", "front_optical_frame")
    # 1.15 m high at the origin, 3 degrees down: what lies 2 m along the axis is 2 cos 3 = 1.997 m
    # ahead and 1.15 - 2 sin 3 = 1.045 m high.
    assert (position.matrix @ [0, 0, 2, 1])[:3] == pytest.approx([1.997, 0.0, 1.045], abs=1e-3)
    frame = captures(source)[0]
    assert frame.rgb.shape == (*SIZE, 3)
    assert frame.depth_mm.shape == SIZE
    # Adam walks at 3.0 m, Bea at 3.8 m; both, 60 cm off the axis, are in view.
    people = frame.depth_mm[20:40]
    assert ((people > 2700) & (people < 3200)).sum() > 30
    assert ((people > 3500) & (people < 4000)).sum() > 20


def test_the_same_every_time_at_any_number_of_threads(tmp_path: Path) -> None:
    path = write_scenario(tmp_path)
    one, other = captures(opened(path)), captures(opened(path, threads=2))
    again = captures(opened(path))
    for a, b, c in zip(one, other, again, strict=True):
        assert a.stamp_ns == b.stamp_ns == c.stamp_ns
        assert np.array_equal(a.rgb, b.rgb)
        assert np.array_equal(a.depth_mm, b.depth_mm)
        assert np.array_equal(a.depth_mm, c.depth_mm)


def test_the_seed_changes_the_noise(tmp_path: Path) -> None:
    path = write_scenario(tmp_path)  # its own seed is 5
    own, named, other = (captures(opened(path, seed))[0] for seed in ("", "@5", "@6"))
    assert np.array_equal(own.depth_mm, named.depth_mm)
    assert not np.array_equal(own.depth_mm, other.depth_mm)


def test_the_sensor_can_be_changed_or_left_out(tmp_path: Path) -> None:
    path = write_scenario(tmp_path)
    clean = captures(opened(path, depth_sensor="off"))[0].depth_mm.astype(int)
    usual = captures(opened(path))[0].depth_mm.astype(int)
    noisy = captures(opened(path, sensor={"noise_px": 0.7}))[0].depth_mm.astype(int)
    assert (clean > 5000).any()  # the far wall, beyond the range of the sensor
    assert usual.max() <= 5000
    both = (clean > 0) & (usual > 0) & (noisy > 0)
    # Ten times the noise in disparity is about as much more error in depth, plus its steps of
    # 1/32 pixel; medians pass over edges.
    error = [float(np.median(np.abs(clean - depth)[both])) for depth in (usual, noisy)]
    assert error[1] > 3 * error[0] > 0


def test_robot_gives_wheel_odometry_and_the_mount_of_its_camera(tmp_path: Path) -> None:
    source = opened(write_scenario(tmp_path, DRIVE))
    found = list(source)
    stamps_ns = [item.stamp_ns for item in found]
    assert stamps_ns == sorted(stamps_ns)
    error_text = [item for item in found if isinstance(item, Odometry)]
    assert [m.stamp_ns for m in error_text] == [EPOCH_NS + k * S // 50 for k in range(61)]
    # 0.2 m/s for 1.2 s are 0.24 m, 10 deg/s are 12 deg; wheels err by 1 % and slip by 2 %.
    assert np.hypot(error_text[-1].x_m, error_text[-1].y_m) == pytest.approx(0.24, rel=0.1)
    assert np.degrees(error_text[-1].theta_rad) == pytest.approx(12, rel=0.2)
    mount, start = source.transforms
    assert (mount.parent, mount.child) == ("base_link", "front_optical_frame")
    assert (start.parent, start.child) == ("map", "odom")
    assert np.allclose(start.matrix, np.eye(4))
    assert len(captures(source)) == FRAMES


def test_frames_outside_the_selection_are_not_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = opened(write_scenario(tmp_path, DRIVE))
    everything = list(source)
    drawn: list[int] = []
    draw = FrameRenderer.view

    def counting(renderer: FrameRenderer, index: int) -> DepthView:
        drawn.append(index)
        return draw(renderer, index)

    monkeypatch.setattr(FrameRenderer, "view", counting)
    late = list(play_source(source, CameraConfig(start_s=0.75, duration_s=0.3)))
    assert drawn == [8, 9, 10]  # at 0.8, 0.9 and 1.0 s
    wanted = [item for item in everything if 75 <= (item.stamp_ns - EPOCH_NS) / 10**7 <= 105]
    assert [item.stamp_ns for item in late] == [item.stamp_ns for item in wanted]
    assert [type(item) for item in late] == [type(item) for item in wanted]


def test_wrong_options_are_refused(tmp_path: Path) -> None:
    assert kind_of("lab:anything") == "lab"
    with pytest.raises(ConfigError, match="unknown scenario nothing"):
        open_source("lab:nothing")
    with pytest.raises(ConfigError, match="expected a whole number after @, got 'x'"):
        open_source("lab:two_easy@x")
    with pytest.raises(ConfigError, match="sensor"):
        opened(write_scenario(tmp_path), sensor={"noize_px": 1.0})
    with pytest.raises(ConfigError, match="Options are mode, threads"):
        open_source("lab:two_easy", options={"made": "depth"})


def test_other_sources_do_not_load_compiled_code() -> None:
    code = (
        "import sys, services.camera.__main__, services.camera.recording;"
        "import services.camera.ros.source;"
        "print('numba' in sys.modules)"
    )
    output = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert output.stdout == "False\n"
