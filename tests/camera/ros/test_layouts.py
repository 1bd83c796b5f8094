"""Bags in the layouts of other drivers and recorders."""

import dataclasses
import itertools
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from people4d.errors import SourceError
from people4d.messages import Odometry
from services.camera.config import CameraConfig
from services.camera.playback import play
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

S = 10**9
NO_TURN = (0.0, 0.0, 0.0, 1.0)


def opened(tmp_path: Path, entries: list[Entry], version: int = 2, **options: Any) -> RosbagSource:
    tmp_path.mkdir(exist_ok=True)
    path = Ros(version).write(tmp_path / ("bag.bag" if version == 1 else "mcap"), entries)
    return RosbagSource(path, RosbagOptions(**options))


def captures(source: RosbagSource) -> list[SourceFrame]:
    return [item for item in source if isinstance(item, SourceFrame)]


def renamed(entries: list[Entry], **names: str) -> list[Entry]:
    topics = {COLOUR: names["colour"], DEPTH: names["depth"], INFO: names["info"]}
    return [(topics[topic], *rest) for topic, *rest in entries]


@pytest.mark.parametrize(
    ("colour", "depth", "info"),
    [
        ("/oak/rgb/image_rect", "/oak/stereo/image_raw", "/oak/rgb/camera_info"),
        ("/depth_camera/image_raw", "/depth_camera/range/image_raw", "/depth_camera/camera_info"),
        ("/rgb/image_raw", "/tof/image", "/rgb/camera_info"),
    ],
)
def test_depth_is_found_by_the_encoding_of_its_images(
    tmp_path: Path, colour: str, depth: str, info: str
) -> None:
    entries = renamed(frames(Ros(2)), colour=colour, depth=depth, info=info)
    source = opened(tmp_path, entries)
    assert (source.topics.colour, source.topics.depth) == (colour, depth)
    assert len(captures(source)) == 3


def test_coloured_image_of_depth_is_not_depth(tmp_path: Path) -> None:
    ros = Ros(2)
    image = ("/camera/depth/image_jet", S, ros.image(rgb(7), "rgb8", S))
    source = opened(tmp_path, [*frames(ros), image])
    assert (source.topics.colour, source.topics.depth) == (COLOUR, DEPTH)


def test_infrared_of_16_bits_is_not_depth(tmp_path: Path) -> None:
    ros = Ros(2)
    infrared = ("/kinect2/qhd/image_ir", S, ros.image(depth_mm(9), "16UC1", S))
    assert opened(tmp_path, [*frames(ros), infrared]).topics.depth == DEPTH


def test_compressed_depth_is_known_by_its_bytes(tmp_path: Path) -> None:
    ros = Ros(2)
    png = cv2.imencode(".png", depth_mm())[1].tobytes()
    entries = [entry for entry in frames(ros) if entry[0] != DEPTH]
    message = ros.compressed(png, "png", S)
    entries.append(("/tof/image/compressed", S, message))
    assert opened(tmp_path, entries).topics.depth == "/tof/image/compressed"


def test_first_image_of_another_size_is_left_to_the_size_check(tmp_path: Path) -> None:
    # realsense2_camera sends unaligned images on the aligned topic now and then.
    ros = Ros(2)
    entries = frames(ros)
    large = ros.image(np.full((9, 12), 1000, np.uint16), "16UC1", entries[2][1])
    entries[2] = (*entries[2][:2], large)
    source = opened(tmp_path, entries)
    assert (source.info.width, source.registration) == (8, None)
    assert [c.depth_mm.shape for c in captures(source)] == [(9, 12), SIZE, SIZE]


def test_calibration_that_fits_the_images_is_used(tmp_path: Path) -> None:
    # First of another resolution, then without numbers, as from uncalibrated drivers.
    ros = Ros(2)
    other = dataclasses.replace(ros.camera_info(fx=5.0), width=4, height=3)
    empty = dataclasses.replace(ros.camera_info(), k=np.zeros(9))
    entries = [(INFO, 1, other), (INFO, 2, empty), *frames(ros)]
    assert opened(tmp_path, entries).info.fx == 10.0


def test_depth_with_another_calibration_is_registered_though_its_frame_is_the_same(
    tmp_path: Path,
) -> None:
    # Depth with half the focal length: the 8 columns of depth cover 16 of colour, so colour's edge
    # columns see depth's columns 2 to 6, all of one plane.
    ros = Ros(2)
    depth_info = "/camera/aligned_depth_to_color/camera_info"
    wide = [*frames(ros), (depth_info, 1, ros.camera_info(fx=5.0))]
    source = opened(tmp_path, wide)
    assert source.registration is not None
    assert captures(source)[1].depth_mm[3, 3] == 1001


def test_recording_of_librealsense_is_registered_by_its_own_extrinsics(tmp_path: Path) -> None:
    # tf/0 leads from the device's first stream, depth, to colour: depth's points lie at x - 0.2 m
    # of colour. At 1 m and fx = 10 px that is 2 px to the left: two columns stay empty.
    ros = Ros(1)
    depth, colour = "/device_0/sensor_0/Depth_0", "/device_0/sensor_1/Color_0"
    entries: list[Entry] = []
    for stream, model, x_m in (
        (depth, "Brown Conrady", 0),
        (colour, "Inverse Brown Conrady", -0.2),
    ):
        info = ros.camera_info(fx=10.0, distortion=[0.0] * 5, model=model, frame="0")
        info = dataclasses.replace(info, K=info.K + (0.1 if stream == depth else 0.0))
        shift = ros.transform("a", "b", (x_m, 0, 0), NO_TURN).transforms[0].transform
        entries.append((f"{stream}/info/camera_info", 1, info))
        entries.append((f"{stream}/tf/0", 1, shift))
    plane = np.full(SIZE, 1000, np.uint16)
    for k in range(3):
        stamp_ns = S + k * 10**8
        pixels = ros.image(plane, "mono16", stamp_ns, frame="1")
        entries.append((f"{depth}/image/data", stamp_ns, pixels))
        image = ros.image(rgb(k), "rgb8", stamp_ns, frame="1")
        entries.append((f"{colour}/image/data", stamp_ns, image))
    source = opened(tmp_path, entries, version=1)
    assert source.info.fx == 10.0
    assert captures(source)[0].depth_mm[0].tolist() == [1000] * 6 + [0] * 2
    # The D405 counts tenths of a millimetre: 0.1 m, at which the shift is more than the image.
    unit = ros.make("std_msgs/msg/Float32", data=0.0001)
    entries.append(("/device_0/sensor_0/option/Depth_Units/value", 1, unit))
    fine = opened(tmp_path / "fine", entries, version=1, depth_aligned=True)
    assert captures(fine)[0].depth_mm.max() == 100


@pytest.mark.parametrize("moves", [False, True])
def test_transforms_that_tf_repeats_are_static_if_they_never_change(
    tmp_path: Path, moves: bool
) -> None:
    # As static_transform_publisher of ROS 1 sends them; depth sits 0.2 m left of colour.
    ros = Ros(1)
    depth_info = "/camera/aligned_depth_to_color/camera_info"
    entries = [*frames(ros), (depth_info, 1, ros.camera_info(fx=10.1))]
    entries = [
        (*entry[:2], dataclasses.replace(entry[2], header=ros.header(entry[1], "depth")))
        if entry[0] == DEPTH
        else entry
        for entry in entries
    ]
    for k in range(5):
        x_m = -0.2 - moves * 0.01 * k
        entries += [
            ("/tf", S + k, ros.transform("/link", f"/{FRAME}", (0, 0, 1), NO_TURN)),
            ("/tf", S + k, ros.transform("/link", "/depth", (x_m, 0, 1), NO_TURN)),
        ]
    entries.sort(key=lambda entry: entry[1])
    if moves:
        with pytest.raises(SourceError, match=r"no transform between them.*tf_as_static"):
            opened(tmp_path, entries, version=1)
        return
    assert captures(opened(tmp_path, entries, version=1))[0].depth_mm[3, -2:].tolist() == [0, 0]


def at_zero(entries: list[Entry]) -> list[Entry]:
    """Return entries with stamps from 0 s and unchanged bag times."""
    first_ns = min(ns for topic, ns, _ in entries if topic != INFO)
    ros = Ros(2)
    return [
        (t, ns, dataclasses.replace(m, header=ros.header(ns - first_ns, m.header.frame_id)))
        for t, ns, m in entries
    ]


def test_stamps_of_a_simulation_begin_at_0_s(tmp_path: Path) -> None:
    source = opened(tmp_path, at_zero(frames(Ros(2))))
    assert [c.stamp_ns for c in captures(source)] == [0, 10**8, 2 * 10**8]
    assert source.counters["zero_stamps"] == 0


def test_loop_of_a_simulation_lasts_as_long_as_the_recording(tmp_path: Path) -> None:
    # Three frames 0.1 s apart: each round takes 0.3 s, without end.
    source = opened(tmp_path, at_zero(frames(Ros(2))))
    stamps = [item.stamp_ns for item in itertools.islice(play(source, CameraConfig(loop=True)), 30)]
    assert stamps == [k * 10**8 for k in range(30)]


def test_single_empty_stamp_among_wall_times_is_the_bags_time(tmp_path: Path) -> None:
    ros = Ros(2)
    entries = frames(ros)
    late = [(t, ns + 100 * S, m) for t, ns, m in entries]
    late = [
        (t, ns, dataclasses.replace(m, header=ros.header(ns if i != 3 else 0, FRAME)))
        for i, (t, ns, m) in enumerate(late)
    ]
    source = opened(tmp_path, late)
    assert [c.stamp_ns for c in captures(source)] == [101 * S, 101 * S + 10**8, 101 * S + 2 * 10**8]
    assert source.counters["zero_stamps"] == 1


def with_odometry(*topics: str) -> list[Entry]:
    ros = Ros(2)
    mount = ros.transform("base_link", FRAME, (1, 0, 0), NO_TURN)
    entries: list[Entry] = [(TF, 1, mount), *frames(ros)]
    for k, topic in enumerate(topics):
        entries.append((topic, S - 1, ros.odometry(3 + k, 4, 0.5, S - 1)))
    return entries


def test_fused_odometry_is_preferred_to_its_inputs(tmp_path: Path) -> None:
    source = opened(tmp_path, with_odometry(ODOMETRY, "/odometry/filtered"))
    assert [t.parent for t in source.transforms] == ["base_link"]
    assert [item.x_m for item in source if isinstance(item, Odometry)] == [4]


def test_several_topics_of_odometry_are_refused_with_their_names(tmp_path: Path) -> None:
    entries = with_odometry(ODOMETRY, "/wheels/odom")
    with pytest.raises(SourceError, match=r"odometry: /odom, /wheels/odom.*odometry_topic"):
        opened(tmp_path, entries)
    source = opened(tmp_path / "named", entries, odometry_topic=ODOMETRY)
    assert [item.x_m for item in source if isinstance(item, Odometry)] == [3]
