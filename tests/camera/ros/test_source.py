"""Bags of both ROS generations, read without ROS."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from people4d.errors import SourceError
from people4d.messages import Odometry
from services.camera.ros.camera import RosbagOptions
from services.camera.ros.source import RosbagSource
from services.camera.source import SourceFrame
from tests.camera.ros.bags import (
    COLOUR,
    DEPTH,
    FRAME,
    INFO,
    ODOMETRY,
    SIZE,
    TF,
    Entry,
    Ros,
    depth_mm,
    frames,
    rgb,
)

FORMATS = [(1, "bag.bag"), (2, "bag_sqlite3"), (2, "bag_mcap")]


def captures(source: RosbagSource) -> list[SourceFrame]:
    return [item for item in source if isinstance(item, SourceFrame)]


def written(tmp_path: Path, entries: list[Entry]) -> Path:
    return Ros(2).write(tmp_path / "mcap", entries)


@pytest.mark.parametrize(("version", "name"), FORMATS)
def test_every_format_gives_the_same_frames(tmp_path: Path, version: int, name: str) -> None:
    ros = Ros(version)
    path = ros.write(tmp_path / name, frames(ros))
    source = RosbagSource(path, RosbagOptions())
    for _ in range(2):  # a recording can be played again
        found = captures(source)
        assert [c.stamp_ns for c in found] == [10**9, 11 * 10**8, 12 * 10**8]
        assert [c.depth_mm[0].tolist() for c in found[:1]] == [[0] + [1000] * 7]
        assert np.array_equal(found[2].rgb, rgb(2))
    info = source.info
    assert (info.frame_id, info.width, info.height, info.fx, info.cx) == (FRAME, 8, 6, 10.0, 4.0)
    assert (info.distortion_model, info.distortion) == ("plumb_bob", (0.1, 0.0, 0.0, 0.0, 0.0))
    assert source.registration is None
    assert source.counters["unpaired"] == 0


def test_a_single_mcap_file_and_a_single_db3_file_are_bags_too(tmp_path: Path) -> None:
    ros = Ros(2)
    for name, suffix in (("one_mcap", "mcap"), ("two", "db3")):
        folder = ros.write(tmp_path / name, frames(ros))
        file = next(folder.glob(f"*.{suffix}"))
        assert len(captures(RosbagSource(file, RosbagOptions()))) == 3


def test_static_transforms_chain_from_map_to_the_optical_frame(tmp_path: Path) -> None:
    # camera_link stands 2 m left of and 1 m above map and looks along map's +y (yaw 90 deg).
    # Its optical frame has z along the link's x: the quaternion of roll -90, yaw -90 deg.
    # A point 3 m ahead of the lens is 3 m along map's y: (0, 2 + 3, 1).
    ros = Ros(2)
    half = math.sqrt(0.5)
    optical = (-0.5, 0.5, -0.5, 0.5)
    chain = [
        (TF, 1, ros.transform("/map", "camera_link", (0, 2, 1), (0, 0, half, half))),
        (TF, 2, ros.transform("camera_link", FRAME, (0, 0, 0), optical)),
    ]
    source = RosbagSource(written(tmp_path, chain + frames(ros)), RosbagOptions())
    (transform,) = source.transforms
    assert (transform.parent, transform.child) == ("map", FRAME)
    assert (transform.matrix @ (0, 0, 3, 1))[:3] == pytest.approx([0, 5, 1])


def test_a_camera_on_a_moving_base_is_given_in_the_base(tmp_path: Path) -> None:
    ros = Ros(2)
    entries = [
        (TF, 1, ros.transform("base_link", FRAME, (1, 0, 0), (0, 0, 0, 1))),
        (ODOMETRY, 2, ros.odometry(3, 4, 0.5, 999_000_000)),
        *frames(ros),
    ]
    source = RosbagSource(written(tmp_path, entries), RosbagOptions())
    assert [t.parent for t in source.transforms] == ["base_link"]
    odometry = next(item for item in source if isinstance(item, Odometry))
    assert (odometry.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert odometry.stamp_ns == 999_000_000
    assert (odometry.x_m, odometry.y_m) == (3, 4)
    assert odometry.theta_rad == pytest.approx(0.5)
    assert odometry.covariance is not None
    assert odometry.covariance.tolist() == np.diag([0.1, 0.2, 0.3]).tolist()
    assert odometry.twist is not None
    assert odometry.twist.tolist() == [0.5, 0.0, 0.25]


def test_depth_of_another_camera_is_registered_by_the_bags_own_transforms(tmp_path: Path) -> None:
    # The depth camera sits 0.2 m left of colour, so in colour's frame its points lie at x - 0.2.
    # At 1 m and fx = 10 px that is 10 * 0.2 / 1 = 2 px to the left: two columns stay empty.
    ros = Ros(2)
    depth_frame, topic = "camera_depth_optical_frame", "/camera/depth/image_raw"
    plane = np.full(SIZE, 1000, np.uint16)
    entries: list[Entry] = [
        (TF, 1, ros.transform(FRAME, depth_frame, (-0.2, 0, 0), (0, 0, 0, 1))),
        (INFO, 1, ros.camera_info()),
        ("/camera/depth/camera_info", 1, ros.camera_info(frame="d")),
        (COLOUR, 2, ros.image(rgb(), "rgb8", 10**9)),
        (topic, 2, ros.image(plane, "16UC1", 10**9, frame=depth_frame)),
    ]
    path = written(tmp_path, entries)
    # Both cameras have one calibration here, which otherwise is a sign of alignment.
    (capture,) = captures(RosbagSource(path, RosbagOptions(depth_aligned=False)))
    assert capture.depth_mm[0].tolist() == [1000] * 6 + [0] * 2
    (aligned,) = captures(RosbagSource(path, RosbagOptions(depth_aligned=True)))
    assert aligned.depth_mm.min() == 1000


def test_depth_that_cannot_be_registered_is_refused(tmp_path: Path) -> None:
    ros = Ros(2)
    entries: list[Entry] = [
        (INFO, 1, ros.camera_info()),
        (COLOUR, 2, ros.image(rgb(), "rgb8", 10**9)),
        ("/depth/image", 2, ros.image(depth_mm(), "16UC1", 10**9, frame="other")),
    ]
    with pytest.raises(SourceError, match=r"frame other.*no CameraInfo of depth.*depth_aligned"):
        RosbagSource(written(tmp_path, entries), RosbagOptions())


def test_rgbd_messages_of_realsense(tmp_path: Path) -> None:
    ros = Ros(2)
    message = ros.make(
        "realsense2_camera_msgs/msg/RGBD",
        header=ros.header(5 * 10**9),
        rgb_camera_info=ros.camera_info(fx=12.0),
        depth_camera_info=ros.camera_info(fx=12.0),
        rgb=ros.image(rgb(9), "rgb8"),
        depth=ros.image(depth_mm(700), "16UC1"),
    )
    path = written(tmp_path, [("/camera/rgbd", 7, message)])
    source = RosbagSource(path, RosbagOptions())
    (capture,) = captures(source)
    assert (capture.stamp_ns, capture.rgb[0, 0, 0], capture.depth_mm[1, 1]) == (5 * 10**9, 9, 700)
    assert source.info.fx == 12.0


def test_header_without_stamp_falls_back_to_the_bags_time(tmp_path: Path) -> None:
    ros = Ros(2)
    entries: list[Entry] = [
        (INFO, 1, ros.camera_info()),
        (COLOUR, 123, ros.image(rgb(), "rgb8")),
        (DEPTH, 124, ros.image(depth_mm(), "16UC1")),
    ]
    source = RosbagSource(written(tmp_path, entries), RosbagOptions())
    assert [c.stamp_ns for c in captures(source)] == [123]
    assert source.counters["zero_stamps"] == 2


def test_bad_images_are_counted_and_left_out(tmp_path: Path) -> None:
    ros = Ros(2)
    entries = frames(ros)
    entries[3] = (COLOUR, entries[3][1], ros.image(rgb(), "bayer_rggb8", 11 * 10**8))
    source = RosbagSource(written(tmp_path, entries), RosbagOptions())
    assert [c.stamp_ns for c in captures(source)] == [10**9, 12 * 10**8]
    assert source.counters["bad_images"] == 1


@pytest.mark.parametrize(
    ("info", "message"),
    [
        (None, rf"no depth images.*{COLOUR} \(sensor_msgs/Image\)"),
        ({"fx": math.nan}, r"focal lengths > 0, got fx nan.*options.calibration"),
        ({"distortion": (0.1, 0, 0, 0), "model": "ftheta"}, "ftheta"),
    ],
)
def test_bag_without_depth_or_a_usable_lens_is_refused(
    tmp_path: Path, info: dict[str, Any] | None, message: str
) -> None:
    ros = Ros(2)
    entries = [entry for entry in frames(ros) if info is not None or entry[0] != DEPTH]
    entries[0] = (*entries[0][:2], ros.camera_info(**(info or {})))
    with pytest.raises(SourceError, match=message):
        RosbagSource(written(tmp_path, entries), RosbagOptions())


@pytest.mark.slow
@pytest.mark.parametrize(("version", "name"), FORMATS)
def test_cut_and_damaged_bags_end_in_one_sentence(tmp_path: Path, version: int, name: str) -> None:
    ros = Ros(version)
    path = ros.write(tmp_path / name, frames(ros))
    file = path if path.is_file() else max(path.iterdir(), key=lambda f: f.stat().st_size)
    data = file.read_bytes()
    generator = np.random.default_rng(0)
    for share in (0.0, 0.1, 0.5, 0.9, 0.999):
        file.write_bytes(data[: int(len(data) * share)])
        play_or_refuse(path)
    for _ in range(30):
        damaged = bytearray(data)
        for position in generator.integers(0, len(data), 20):
            damaged[position] = generator.integers(256)
        file.write_bytes(bytes(damaged))
        play_or_refuse(path)


def play_or_refuse(path: Path) -> None:
    """A damaged bag gives valid frames or a SourceError."""
    problem = ""
    try:
        for capture in captures(RosbagSource(path, RosbagOptions())):
            assert capture.rgb.dtype == np.uint8
            assert capture.depth_mm.ndim == 2
    except SourceError as error:
        problem = str(error)
    assert "\n" not in problem


def test_registered_bags_of_a_service_robot(shared: Path) -> None:
    bags = sorted((shared / "data/rgbd/tue").glob("*.bag"))
    assert len(bags) == 5
    for path in bags:
        source = RosbagSource(path, RosbagOptions())
        (capture,) = captures(source)
        assert capture.rgb.shape == (480, 640, 3)
        # 32FC1 with NaN: a third of the pixels has a reading, of 0.4 m to 10 m.
        valid = capture.depth_mm[capture.depth_mm > 0]
        assert 0.25 < valid.size / capture.depth_mm.size < 0.45
        assert valid.min() > 400
        assert valid.max() < 10_000
        assert source.info.fx == pytest.approx(537.03, abs=0.01)
        # Colour and depth are 0.11 to 0.34 s apart in these bags: paired, and counted.
        assert source.counters["loose_pairs"] == 1
