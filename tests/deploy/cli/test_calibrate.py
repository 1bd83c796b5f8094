"""people4d calibrate on recordings: the files it writes, and nothing when it refuses."""

import contextlib
import itertools
import threading
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from common.calibration.checks import PEOPLE_MIN
from common.calibration.tags import Tag
from common.calibration.transforms_file import read_pose, read_transforms
from common.io.images import compress
from common.io.recording import RecordingWriter
from deploy.cli import app
from deploy.cli.live.calibrate import CalibrationSession, listen
from people4d.errors import CalibrationError, SourceError
from people4d.messages import CameraInfo, Detections, Message
from people4d.queue import Arrival
from tests.builders import rgbd_frame, static_transform
from tests.common.calibration.test_tags import image_of
from tests.common.calibration.walks import (
    EPOCH_NS,
    SECOND_NS,
    WalkCamera,
    floor_depth_mm,
    messages,
    square,
    wander,
)
from tests.common.calibration.walks import Path as WalkPath
from tests.network import WAIT_S, Network


def record(path: Path, cameras: list[WalkCamera], people: list[WalkPath], *others: Message) -> Path:
    """Write the detections of cameras to a recording, and other messages after them."""
    with RecordingWriter(path) as writer:
        for arrived_ns, message in sorted(messages(cameras, people), key=lambda item: item[0]):
            writer.write(message, arrived_ns)
        for other in others:
            writer.write(other, arrived_ns)
    return path


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["calibrate", *map(str, arguments)])
    return result.exit_code, result.output + str(result.exception or "")


def test_poses_of_a_recording_are_written_with_a_page(tmp_path: Path) -> None:
    cameras = square("a", "b")
    source = record(tmp_path / "walk.mcap", cameras, [wander(3), wander(4)])
    out = tmp_path / "poses.toml"
    code, said = run(source, "--out", out)
    assert code == 0, said
    found = read_transforms(out)
    assert found.reference == "a"
    assert found.cameras["b"].frame_id == "b_optical_frame"
    assert found.cameras["b"].clock_offset_ms == pytest.approx(210, abs=10)
    assert found.cameras["b"].pairs["a"] > 5
    between = np.linalg.norm(read_pose(out, "a")[:3, 3] - read_pose(out, "b")[:3, 3])
    assert between == pytest.approx(6.0, abs=0.06)
    page = out.with_suffix(".html").read_text()
    assert page.count("<polyline") > 10
    assert "http" not in page
    assert run(source, "--out", out)[0] != 0  # exists
    assert run(source, "--out", out, "--force")[0] == 0


@pytest.mark.parametrize(
    ("people", "options", "problem"),
    [
        ([lambda _: (0.3, 0.1)], (), "no person walked"),
        ([wander(3)], ("--cameras", "a,x"), "x sends no detections"),
        ([wander(3)], ("--cameras", "a"), "two names or more"),
        ([wander(3)], ("--reference", "x"), "unknown camera x"),
    ],
)
def test_refusal_writes_nothing(
    tmp_path: Path, people: list[WalkPath], options: tuple[str, ...], problem: str
) -> None:
    source = record(tmp_path / "walk.mcap", square("a", "b"), people)
    code, said = run(source, "--out", tmp_path / "poses.toml", *options)
    assert code != 0
    assert problem in said
    assert [path.name for path in tmp_path.iterdir()] == ["walk.mcap"]


def test_floor_is_that_of_depth_images_that_come(tmp_path: Path) -> None:
    cameras = square("a", "b")
    rgb = np.zeros((480, 640, 3), np.uint8)
    frames = []
    for one in cameras:
        depth_mm = floor_depth_mm(one)
        at = [EPOCH_NS + k * SECOND_NS for k in range(4)]
        frames += [
            compress(rgbd_frame(camera=one.name, rgb=rgb, depth_mm=depth_mm, stamp_ns=stamp_ns))
            for stamp_ns in at
        ]
    source = record(tmp_path / "walk.mcap", cameras, [wander(3), wander(4)], *frames)
    out = tmp_path / "poses.toml"
    code, said = run(source, "--out", out)
    assert code == 0, said
    assert "The floor is measured in the depth of a, b" in said
    assert read_pose(out, "a")[2, 3] == pytest.approx(2.2, abs=0.01)


def test_tags_in_the_frames_of_one_camera_define_the_map(tmp_path: Path) -> None:
    cameras = square("a", "b")
    tags = {
        3: Tag(size_m=0.5, position_m=(0.5, 1.5, 1.2), facing_deg=-135),
        7: Tag(size_m=0.6, position_m=(0.0, -0.3, 0.0), facing_deg=45, flat=True),
    }
    infos = {
        message.camera: message
        for _, message in messages(cameras, [])
        if isinstance(message, CameraInfo)
    }
    rgb = image_of(tags, cameras[0].map_from_camera, infos["a"])
    depth_mm = np.full(rgb.shape[:2], 3000, np.uint16)
    frame = compress(rgbd_frame(camera="a", rgb=rgb, depth_mm=depth_mm))
    source = record(tmp_path / "walk.mcap", cameras, [wander(3), wander(4)], frame)
    known = tmp_path / "tags.toml"
    rows = [
        f"[tags.{n}]\nsize_m = {t.size_m}\nposition_m = {list(t.position_m)}\n"
        f"facing_deg = {t.facing_deg}\nflat = {str(t.flat).lower()}"
        for n, t in tags.items()
    ]
    known.write_text("\n".join(rows))
    out = tmp_path / "poses.toml"
    code, said = run(source, "--out", out, "--tags", known)
    assert code == 0, said
    for camera in cameras:
        apart = read_pose(out, camera.name)[:3, 3] - camera.map_from_camera[:3, 3]
        assert np.linalg.norm(apart) < 0.12
    without = record(tmp_path / "no_images.mcap", cameras, [wander(3), wander(4)])
    code, said = run(without, "--out", tmp_path / "other.toml", "--tags", known)
    assert code != 0
    assert "no camera saw a tag" in said


@pytest.mark.parametrize(
    ("edges", "problem"),
    [
        ([("base_link", "a_optical_frame")], "a is mounted on base_link"),
        ([("x", "y"), ("y", "x")], "form a loop: "),
    ],
)
def test_frames_that_cannot_hang_on_the_map_are_refused(
    tmp_path: Path, edges: list[tuple[str, str]], problem: str
) -> None:
    transforms = [static_transform(np.eye(4), child, parent) for parent, child in edges]
    source = record(tmp_path / "walk.mcap", square("a", "b"), [wander(3)], *transforms)
    code, said = run(source, "--out", tmp_path / "poses.toml")
    assert code != 0
    assert problem in said


def arrivals(cameras: list[WalkCamera], people: list[WalkPath]) -> Iterator[Arrival]:
    """Yield live messages by the time of their arrival."""
    for arrived_ns, message in sorted(messages(cameras, people), key=lambda item: item[0]):
        yield Arrival(message, arrived_ns + SECOND_NS, arrived_ns + SECOND_NS)


def test_live_walk_is_calibrated_at_the_latest_at_its_end() -> None:
    cameras = square("a", "b")
    session = CalibrationSession(set(), "", 1.0)
    found = listen(session, arrivals(cameras, [wander(3), wander(4)]), 100.0)
    between = found.map_from_camera["a"][:3, 3] - found.map_from_camera["b"][:3, 3]
    assert np.linalg.norm(between) == pytest.approx(6.0, abs=0.1)


def test_live_walk_that_shows_nothing_ends_after_its_time() -> None:
    def standing() -> Iterator[Arrival]:
        yield from arrivals(square("a", "b"), [lambda _: (0.2, 0.1)])
        pytest.fail("the time was over before")

    with pytest.raises(CalibrationError, match="no person walked"):
        listen(CalibrationSession(set(), "", 1.0), standing(), 15.0)


def test_progress_shows_where_each_camera_found_people() -> None:
    session = CalibrationSession(set(), "", 1.0)
    assert session.summary() == "no camera yet"
    # The camera stands at (-3, -3) and looks at the middle; the person stays far away, to its left.
    for arrival in arrivals(square("a"), [lambda _: (-0.6, 0.9)]):
        session.add_message(arrival.message, arrival.received_ns)
    assert "a 200 of 200  #.. ... ..." in session.summary()


def test_ctrl_c_ends_the_walk_with_a_last_attempt() -> None:
    def interrupted() -> Iterator[Arrival]:
        yield from arrivals(square("a", "b"), [wander(3), wander(4)])
        raise KeyboardInterrupt

    found = listen(CalibrationSession(set(), "b", 1.0), interrupted(), 1000.0)
    assert found.reference == "b"


@pytest.mark.network
def test_cameras_of_two_hosts_with_a_router_each_are_heard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    walks = [list(messages([one], [lambda _: (0.2, 0.1)], 4.0)) for one in square("a", "b")]
    heard: Counter[str] = Counter()

    def all_of_both(arrivals: Iterable[Arrival]) -> Iterator[Arrival]:
        for arrival in arrivals:
            yield arrival
            if isinstance(arrival.message, Detections):
                heard[arrival.message.camera] += 1
            if min(heard["a"], heard["b"]) > PEOPLE_MIN:
                return

    monkeypatch.setattr(  # not by seconds: the sessions start late on a busy machine
        "deploy.cli.live.calibrate.listen",
        lambda session, arrivals, _: listen(session, all_of_both(arrivals), WAIT_S),
    )
    with contextlib.ExitStack() as stack:
        hosts = [Network(), Network()]
        for host in hosts:
            stack.callback(host.close)
        names = [host.robot() for host in hosts]
        buses = [host.open(name) for host, name in zip(hosts, names, strict=True)]
        ended = threading.Event()

        def publish() -> None:
            sent = [(bus, m) for bus, walk in zip(buses, walks, strict=True) for _, m in walk]
            for later_ns in itertools.count(0, 4 * SECOND_NS):  # old frames would be ignored
                for bus, message in sent:
                    later = message.stamp_ns + later_ns
                    bus.publish(msgspec.structs.replace(message, stamp_ns=later))
                if ended.wait(0.05):
                    return

        thread = threading.Thread(target=publish)
        thread.start()
        endpoints = ",".join(host.endpoint for host in hosts)
        command = ["calibrate", "--hosts", ",".join(names), "--connect", endpoints]
        command += ["--seconds", "10", "--out", str(tmp_path / "poses.toml")]
        result = CliRunner().invoke(app, command)
        ended.set()
        thread.join()
    assert "Walk about in curves" in result.stdout
    assert result.exit_code == 1
    assert "before a and b" in result.stderr or "a and b saw" in result.stderr
    assert not (tmp_path / "poses.toml").exists()


def test_routers_that_do_not_fit_the_hosts_are_refused(tmp_path: Path) -> None:
    command = ["--hosts", "x,y,z", "--connect", "tcp/h:1,tcp/i:1"]
    code, said = run(*command, "--out", tmp_path / "poses.toml")
    assert code != 0
    assert "expected one router, or 3" in said


def write_poses(path: Path, matrix: str) -> Path:
    lines = ['reference = "a"', "[cameras.a]", 'frame_id = "a_optical_frame"', f"matrix = {matrix}"]
    path.write_text("\n".join(lines))
    return path


def test_pose_is_read_by_the_name_of_the_camera(tmp_path: Path) -> None:
    poses = write_poses(
        tmp_path / "poses.toml", "[[0, 0, 1, 2], [-1, 0, 0, 3], [0, -1, 0, 1], [0, 0, 0, 1]]"
    )
    assert read_pose(poses, "a")[:3, 3].tolist() == [2, 3, 1]
    with pytest.raises(SourceError, match=r"no camera b. It has a"):
        read_pose(poses, "b")


@pytest.mark.parametrize(
    "matrix",
    [
        "[[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
        "[[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
        "[[nan, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
        "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]",
        '"x"',
    ],
)
def test_matrix_that_is_no_pose_is_refused(tmp_path: Path, matrix: str) -> None:
    with pytest.raises(SourceError, match="transforms"):
        read_pose(write_poses(tmp_path / "poses.toml", matrix), "a")
