"""The pipeline in a program of one's own."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest

from deploy.program.images import IMAGES, CameraImages
from evaluation.pipeline import pipeline, play
from people4d.codec import encode
from people4d.errors import ConfigError, People4dError, SourceError
from people4d.messages import U8, U16, CameraInfo, Odometry, RgbdFrame, StaticTransform, Tracks
from people4d_robot import Camera, Intrinsics, Pipeline, mount
from services.camera.config import CameraConfig
from services.camera.source import SourceFrame
from services.camera.sources import open_source
from services.detector.config import DetectorConfig
from tests import DEMO, ROOT

EXAMPLES = ROOT / "examples" / "in_process"
FRAMES = 25
LENS = Intrinsics(fx=60.0, fy=60.0, cx=32.0, cy=24.0)
RGB: U8 = np.zeros((48, 64, 3), np.uint8)
DEPTH: U16 = np.full((48, 64), 2000, np.uint16)


@pytest.fixture(scope="module")
def small() -> Iterator[Pipeline]:
    """Pipeline that got a frame of a small camera."""
    with Pipeline(settings={"tracker.max_lost_s": 3.0}) as pipeline:
        pipeline.add_camera("front", LENS, mount(z_m=1.2))
        assert pipeline.process(RGB, DEPTH, 0.5) is not None
        yield pipeline


@pytest.mark.slow
def test_people_are_those_of_the_services_byte_for_byte() -> None:
    camera = CameraConfig(
        source=str(DEMO), playback="lockstep", start_delay_s=0.0, max_frames=FRAMES
    )
    messages = [one for step in play(camera, pipeline(DetectorConfig())) for one in step.messages]
    (info,) = (one for one in messages if isinstance(one, CameraInfo))
    (pose,) = (one for one in messages if isinstance(one, StaticTransform))
    frames = [one for one in messages if isinstance(one, RgbdFrame)]
    expected = [encode(one) for one in messages if isinstance(one, Tracks)]
    matrix = [[info.fx, 0.0, info.cx], [0.0, info.fy, info.cy], [0.0, 0.0, 1.0]]
    with Pipeline() as own:
        own.add_camera(info.camera, matrix, pose.matrix, max_depth_m=info.max_depth_m)
        buffers = np.empty_like(frames[0].rgb), np.empty_like(frames[0].depth_mm)
        found = []
        for frame in frames:
            np.copyto(buffers[0], frame.rgb)  # as cameras that give the same memory each time
            np.copyto(buffers[1], frame.depth_mm)
            people = own.process(*buffers, Fraction(frame.stamp_ns, 10**9))
            assert people is not None
            found.append(people)
        assert own.problems() == []
    assert sum(len(people.tracks) for people in found) > FRAMES
    assert [encode(people) for people in found] == expected


def test_frame_without_people_gives_a_message_without_tracks(small: Pipeline) -> None:
    people = small.process(RGB, DEPTH, 1.0)
    assert people is not None
    assert (people.tracks, people.camera, people.stamp_ns) == ((), "front", 10**9)
    metres = np.full(DEPTH.shape, 2.0)
    metres[0, 0] = np.nan
    assert small.process(RGB, metres, 1.1) is not None


@pytest.mark.parametrize(
    ("rgb", "depth", "says"),
    [
        (RGB[:, :, 0], DEPTH, "rgb is uint8 (48, 64), expected uint8 (48, 64, 3) red first"),
        (np.zeros((48, 64, 4), np.uint8), DEPTH, "rgb is uint8 (48, 64, 4)"),
        (RGB, None, "depth is NoneType, expected an array"),
        (RGB[:24], DEPTH[:24], "rgb is uint8 (24, 64, 3), expected uint8 (48, 64, 3)"),
        (RGB, DEPTH[:24], "depth is uint16 (24, 64), expected uint16 (48, 64) millimetres"),
        (RGB, DEPTH.astype(np.int32), "depth is int32"),
        (RGB, DEPTH * 1.0, "millimetres, declared as metres"),
        (RGB / 255.0, DEPTH, "rgb is float64"),
        (None, DEPTH, "rgb is NoneType, expected an array"),
    ],
)
def test_wrong_images_are_refused_by_what_they_are(
    small: Pipeline, rgb: U8, depth: U16, says: str
) -> None:
    with pytest.raises(SourceError) as error:
        small.process(rgb, depth, 3.0)
    assert says in error.value.problem
    assert error.value.hint == IMAGES


def test_wrong_first_frame_does_not_fix_the_size(small: Pipeline) -> None:
    with Pipeline() as own:
        own.add_camera("front", LENS)
        for image in (np.uint8(0), [[0, 0], [0]], None):
            with pytest.raises(SourceError, match="rgb is not an image"):
                own.process(image, DEPTH, 0.0)  # type: ignore[arg-type]
        with pytest.raises(SourceError, match=r"expected uint16 \(24, 64\)"):
            own.process(RGB[:24], DEPTH, 0.0)
        assert own.process(RGB, DEPTH, 0.1) is not None


def test_unknown_names_and_impossible_values_are_refused(small: Pipeline) -> None:
    with pytest.raises(ConfigError, match="unknown camera 'rear'; known: front"):
        small.process(RGB, DEPTH, 1.0, "rear")
    with pytest.raises(ConfigError, match="a camera 'front' already"):
        small.add_camera("front", LENS)
    with pytest.raises(ConfigError, match="unknown preset 'bst'"):
        Pipeline("bst")
    with pytest.raises(ConfigError, match="max_lost_s"):
        Pipeline(settings={"tracker.max_lost_s": -1.0})


MATRIX = np.array([[60.0, 0.0, 32.0], [0.0, 60.0, 24.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"pose": 2.0 * np.eye(4)}, "rotation"),
        ({"pose": [[1.0], [1.0, 2.0]]}, "camera 'rear': "),
        ({"name": "a b"}, "camera 'a b': camera: expected 1 to 64 characters"),
        ({"name": 51 * "a"}, "aaa': frame: expected 1 to 64 characters"),
        ({"intrinsics": Intrinsics(fx=-1.0, fy=60.0, cx=32.0, cy=24.0)}, "fx: expected"),
        ({"intrinsics": Intrinsics(fx=np.nan, fy=60.0, cx=32.0, cy=24.0)}, "fx: expected"),
        ({"intrinsics": MATRIX.T}, "3x3 camera matrix with the last row 0 0 1"),
        ({"intrinsics": MATRIX[:2, :2]}, "3x3 camera matrix"),
        ({"max_depth_m": -1.0}, "max_depth_m: expected"),
    ],
)
def test_impossible_camera_is_refused_before_its_first_frame(
    small: Pipeline, arguments: dict[str, Any], says: str
) -> None:
    given = {"name": "rear", "intrinsics": MATRIX} | arguments
    for add in (small.add_camera, Camera):
        with pytest.raises(SourceError) as error:
            add(**given)
        assert says in str(error.value)


def test_fisheye_lens_with_its_size_is_accepted() -> None:
    with Pipeline() as own:
        lens = Intrinsics(
            fx=60.0, fy=60.0, cx=32.0, cy=24.0, distortion=(0.1, 0.0, 0.0, 0.0), fisheye=True
        )
        own.add_camera("wide", msgspec.structs.replace(lens, width=64, height=48))
        assert own.process(RGB, DEPTH, 0.0) is not None


def test_closed_pipeline_refuses_frames() -> None:
    with Pipeline() as own:
        own.add_camera("front", LENS)
    with pytest.raises(People4dError, match="the pipeline is closed"):
        own.process(RGB, DEPTH, 0.0)


def test_frame_older_than_the_last_one_is_refused(small: Pipeline) -> None:
    assert small.process(RGB, DEPTH, 20.0) is not None
    with pytest.raises(SourceError, match=r"0\.1 s older"):
        small.process(RGB, DEPTH, 19.9)
    with pytest.raises(SourceError, match="a frame has the stamp of the one before"):
        small.process(RGB, DEPTH, 20.0)
    later = small.process(RGB, DEPTH, 5000.0)
    assert later is not None
    assert later.stamp_ns == 5000 * 10**9


@pytest.mark.parametrize(
    "stamp", [1795892317025935088, 5e9, np.nan, -np.inf, "0.4", None, np.float32(2.0)]
)
def test_stamp_that_is_not_in_seconds_is_refused_and_later_frames_are_not(stamp: Any) -> None:
    with Pipeline() as own:
        own.add_camera("front", LENS)
        with pytest.raises(SourceError, match="stamp_s: expected seconds, got"):
            own.process(RGB, DEPTH, stamp)
        assert own.process(RGB, DEPTH, 1.0) is not None
        with pytest.raises(SourceError, match="stamp_s: expected seconds, got"):
            own.process(RGB, DEPTH, stamp)
        assert own.process(RGB, DEPTH, 1.1) is not None


def test_pushed_stamp_beyond_the_range_is_refused_and_later_frames_are_not() -> None:
    images = CameraImages("front", LENS)
    with pytest.raises(SourceError, match=r"stamp_ns: expected .* at most, got 18"):
        images.accept(RGB, DEPTH, 18 * 10**18)
    assert images.info is None
    assert images.accept(RGB, DEPTH, 10**9).stamp_ns == 10**9


def test_each_frame_of_two_cameras_gives_its_people() -> None:
    with Pipeline() as own:
        own.add_camera("left", LENS, mount(y_m=1.0))
        own.add_camera("right", LENS, mount(y_m=-1.0))
        times = [k / 30 + offset_s for k in range(10) for offset_s in (0.0, 0.005)]
        found = [own.process(RGB, DEPTH, t, ("left", "right")[k % 2]) for k, t in enumerate(times)]
    assert [round(t * 10**9) for t in times] == [one.stamp_ns for one in found if one]


@pytest.mark.parametrize("late_ns", [0, 10_000_000])
def test_moving_base_carries_the_camera(late_ns: int) -> None:
    with Pipeline() as own:
        own.add_camera("front", LENS, mount(z_m=1.2), parent="base_link")
        own.process(RGB, DEPTH, 1.0)
        assert "no transform map <- front_optical_frame" in own.problems()[0]
    with Pipeline() as own:
        own.add_camera("front", LENS, mount(z_m=1.2), parent="base_link")
        for number in range(3):
            stamp_ns = 10**9 + number * 33_000_000
            own.add_motion(
                Odometry(
                    stamp_ns=stamp_ns - late_ns,
                    sequence=number,
                    frame_id="map",
                    child_frame_id="base_link",
                    x_m=0.01 * number,
                    y_m=0.0,
                    theta_rad=0.0,
                )
            )
            assert own.process(RGB, DEPTH, Fraction(stamp_ns, 10**9)) is not None
        assert own.problems() == []


@pytest.mark.slow
def test_example_of_a_video_and_depth_images_shows_people(tmp_path: Path) -> None:
    motion_jpeg = cv2.VideoWriter.fourcc(*"MJPG")
    video = cv2.VideoWriter(str(tmp_path / "c.avi"), motion_jpeg, 15, (640, 480))
    for number, frame in enumerate(islice(open_source(str(DEMO)), 20)):
        assert isinstance(frame, SourceFrame)
        video.write(cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR))
        cv2.imwrite(str(tmp_path / f"{number:03}.png"), frame.depth_mm)
    video.release()
    done = subprocess.run(
        [sys.executable, EXAMPLES / "opencv_folder.py", tmp_path / "c.avi", tmp_path],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert "(2, " in done.stdout, done.stderr


@pytest.mark.slow
def test_notebook_draws_people(monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = json.loads((EXAMPLES / "people.ipynb").read_text())
    code = "\n".join("".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code")
    scope: dict[str, Any] = {}  # IPython is no dependency: its Image gets the bytes of a PNG
    monkeypatch.chdir(ROOT)
    without = code.replace("from IPython.display import Image\n", "").replace("Image(", "shown = (")
    exec(without, scope)
    image = cv2.imdecode(np.frombuffer(scope["shown"], np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    plain = cv2.cvtColor(scope["frames"][-1].rgb, cv2.COLOR_RGB2BGR)
    assert image.shape == plain.shape
    assert 2000 < np.count_nonzero((image != plain).any(axis=-1)) < 100_000  # lines and labels


def test_file_with_the_name_of_a_package_is_named(tmp_path: Path) -> None:
    (tmp_path / "common.py").touch()
    (tmp_path / "mine.py").write_text("import people4d_robot")
    done = subprocess.run(
        [sys.executable, str(tmp_path / "mine.py")],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    line = done.stderr.splitlines()[-1]
    assert line.startswith("ImportError: ")
    assert line.endswith("common.py hides the package common of people4d-robot: rename it")
