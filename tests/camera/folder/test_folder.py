"""Folders of images."""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io

from people4d.errors import ConfigError, SourceError
from people4d.messages import Odometry
from services.camera.calibration import read_calibration
from services.camera.folder.source import FolderOptions, FolderSource
from services.camera.source import SourceFrame
from services.camera.sources import open_source
from tests import ROOT

LENS = {"fx": 10.0, "fy": 10.0, "cx": 4.0, "cy": 3.0}


def put(path: Path, value: int, depth: bool) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    image = np.full((6, 8), value, np.uint16) if depth else np.full((6, 8, 3), value, np.uint8)
    cv2.imwrite(str(path), image)


def numbered(tmp_path: Path, numbers: tuple[int, ...] = (1, 2, 10)) -> Path:
    for k in numbers:
        put(tmp_path / f"rgb/frame_{k}.png", k, depth=False)
        put(tmp_path / f"depth/d{k:06d}.png", 1000 + k, depth=True)
    (tmp_path / "camera.json").write_text(json.dumps(LENS))
    return tmp_path


def captures(source: FolderSource) -> list[SourceFrame]:
    return [item for item in source if isinstance(item, SourceFrame)]


def test_pairs_by_number_not_by_name(tmp_path: Path) -> None:
    # In text order frame_10 precedes frame_2.
    put(numbered(tmp_path) / "rgb/frame_99.png", 0, depth=False)
    source = FolderSource(tmp_path, FolderOptions(fps=10))
    found = captures(source)
    assert [c.stamp_ns for c in found] == [0, 100_000_000, 200_000_000]
    assert [int(c.rgb[0, 0, 0]) for c in found] == [1, 2, 10]
    assert [int(c.depth_mm[0, 0]) for c in found] == [1001, 1002, 1010]
    assert source.counters["unpaired"] == 1
    assert (source.info.fx, source.info.width, source.transforms) == (10.0, 8, ())


def test_patterns_of_ones_own(tmp_path: Path) -> None:
    put(tmp_path / "a_1_left.png", 5, depth=False)
    put(tmp_path / "z_1.png", 900, depth=True)
    (tmp_path / "camera.json").write_text(json.dumps(LENS))
    options = {"colour": "a_*_left.png", "depth": "z_*.png"}
    (capture,) = list(open_source(str(tmp_path), options=options))
    assert isinstance(capture, SourceFrame)
    assert capture.depth_mm[0, 0] == 900


def test_tum_lists(tmp_path: Path) -> None:
    # 5000 units are 1 m, so 10000 is 2 m. One depth image is 10 ms late; another is 30 ms late and
    # has no partner.
    put(tmp_path / "rgb/a.png", 1, depth=False)
    put(tmp_path / "rgb/b.png", 2, depth=False)
    put(tmp_path / "depth/a.png", 10_000, depth=True)
    put(tmp_path / "depth/b.png", 5_000, depth=True)
    text = "# timestamp filename\n1305031102.175304031 rgb/a.png\n1305031102.5 rgb/b.png\n"
    (tmp_path / "rgb.txt").write_text(text)
    text = "1305031102.185304 depth/a.png\n1305031102.53 depth/b.png\n"
    (tmp_path / "depth.txt").write_text(text)
    (tmp_path / "camera.toml").write_text("[colour]\nfx=10.0\nfy=10.0\ncx=4.0\ncy=3.0\n")
    source = FolderSource(tmp_path, FolderOptions())
    (capture,) = captures(source)
    assert capture.stamp_ns == 1305031102175304031  # a float would lose the last digits
    assert (capture.depth_mm == 2000).all()
    assert source.counters["unpaired"] == 2
    (tmp_path / "rgb.txt").write_text("now rgb/a.png\n")
    with pytest.raises(SourceError, match=r"rgb.txt, line 1: expected a time and a file name"):
        FolderSource(tmp_path, FolderOptions())


def test_track_gives_times_odometry_and_a_moving_mount(tmp_path: Path) -> None:
    numbered(tmp_path, (0, 1))
    (tmp_path / "camera.json").unlink()
    poses = np.stack([np.eye(4), np.eye(4)])
    poses[1, 0, 3] = 0.5
    intrinsics, times_s = np.array([10, 10, 4, 3]), np.array([0.5, 0.75])
    odom = np.array([(0, 0, 0), (0.5, 0, 4)])
    np.savez(tmp_path / "gt.npz", K=intrinsics, t=times_s, T_world_cam=poses, odom=odom)
    source = FolderSource(tmp_path, FolderOptions())
    items = list(source)
    assert [(type(i).__name__, i.stamp_ns) for i in items] == [
        ("Odometry", 500_000_000),
        ("SourceFrame", 500_000_000),
        ("Odometry", 750_000_000),
        ("SourceFrame", 750_000_000),
    ]
    last = items[2]
    assert isinstance(last, Odometry)
    assert last.x_m == 0.5
    assert last.theta_rad == pytest.approx(4 - 2 * np.pi)
    assert [t.parent for t in source.transforms] == ["base_link"]
    poses[1] = poses[0]
    np.savez(tmp_path / "gt.npz", K=intrinsics, t=times_s, T_world_cam=poses)
    still = FolderSource(tmp_path, FolderOptions())
    assert [t.parent for t in still.transforms] == ["map"]
    assert not still.odometry


def test_mat_depth_is_registered_with_the_calibration_of_a_mat_file(tmp_path: Path) -> None:
    # The depth camera sits 0.2 m right of colour: at 1 m and fx = 10 px that is 2 px.
    put(tmp_path / "im7.jpg", 50, depth=False)
    scipy.io.savemat(tmp_path / "im7.mat", {"depth_array": np.full((6, 8), 1000, np.uint16)})
    camera = {"K": [[10.0, 0, 4], [0, 10, 3], [0, 0, 1]], "DistCoef": [[0.0] * 5]}
    calibration = {"RGB_cam": camera, "Depth_cam": camera, "R_d_to_rgb": np.eye(3)}
    file = tmp_path / "CalibrationData.mat"
    scipy.io.savemat(file, calibration | {"T_d_to_rgb": [[0.2], [0], [0]]})
    (capture,) = captures(FolderSource(tmp_path, FolderOptions()))
    assert capture.depth_mm[0].tolist() == [0, 0] + [1000] * 6
    (capture,) = captures(FolderSource(tmp_path, FolderOptions(depth_offset_px=(1, 0))))
    assert capture.depth_mm[0].tolist() == [0, 0, 0] + [1000] * 5
    scipy.io.savemat(file, {"RGB_cam": camera})
    with pytest.raises(SourceError, match="has no 'Depth_cam'"):
        read_calibration(file)
    scipy.io.savemat(tmp_path / "im7.mat", {"z": np.full((6, 8), 1000, np.uint16)})
    with pytest.raises(SourceError, match="has no array 'depth_array'"):
        FolderSource(tmp_path, FolderOptions())


def test_ros_calibration_yaml(tmp_path: Path) -> None:
    file = tmp_path / "camera_info.yaml"
    file.write_text(
        "image_width: 8\nimage_height: 6\ndistortion_model: plumb_bob\n"
        "camera_matrix: {rows: 3, cols: 3, data: [10, 0, 4, 0, 11, 3, 0, 0, 1]}\n"
        "distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0.2, 0, 0, 0]}\n"
    )
    intrinsics = read_calibration(file).colour
    assert intrinsics is not None
    assert (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy) == (10, 11, 4, 3)
    assert (intrinsics.width, intrinsics.height) == (8, 6)
    assert intrinsics.distortion == (0.1, 0.2, 0, 0, 0)


def test_damaged_images_are_counted_and_left_out(tmp_path: Path) -> None:
    numbered(tmp_path)
    (tmp_path / "rgb/frame_2.png").write_bytes(b"\x89PNG\r\n\x1a\n junk")
    put(tmp_path / "depth/d000010.png", 7, depth=False)  # colour where depth should be
    source = FolderSource(tmp_path, FolderOptions())
    assert [c.stamp_ns for c in captures(source)] == [0]
    assert source.counters["bad_images"] == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not valid"),
        ('{"fx": 10}', "missing required field"),
        (json.dumps(LENS | {"fx": -1}), "expected 1 to 100000.0, got -1"),
        (json.dumps(LENS | {"width": 640, "height": 480}), "for 640x480 pixels, images have 8x6"),
        (json.dumps(LENS | {"distortion": [1, 2]}), "distortion_model"),
        (json.dumps({"depth": LENS}), "has no calibration"),
    ],
)
def test_calibration_that_can_not_be_used(tmp_path: Path, text: str, message: str) -> None:
    numbered(tmp_path)
    (tmp_path / "camera.json").write_text(text)
    with pytest.raises(SourceError, match=message):
        FolderSource(tmp_path, FolderOptions())


def test_empty_folder_and_wrong_options(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no numbered pairs"):
        FolderSource(tmp_path, FolderOptions())
    with pytest.raises(ConfigError, match=r"unknown field `color`.*Options are colour"):
        open_source(str(tmp_path), options={"color": "*.png"})
    with pytest.raises(ConfigError, match="fps"):
        open_source(str(tmp_path), options={"fps": 0})


@pytest.mark.slow
def test_lab(shared: Path) -> None:
    source = FolderSource(shared / "data/lab/two", FolderOptions())
    first = captures(source)[0]
    assert (len(source.pairs), first.rgb.shape, source.info.fx) == (150, (480, 640, 3), 615.0)
    assert source.transforms[0].matrix[2, 3] == pytest.approx(1.15)
    robot = FolderSource(shared / "data/lab/robot", FolderOptions())
    assert (robot.transforms[0].parent, bool(robot.odometry)) == ("base_link", True)


@pytest.mark.slow
def test_registered_depth_edges_meet_colour_edges(shared: Path) -> None:
    # Without registration the outlines of people in depth are 9 px off, with registration at most 1
    # px. The shift at the peak of the colour gradient across depth outlines is the offset.
    options = FolderOptions(fps=10, depth_offset_px=(9, 3))
    source = FolderSource(shared / "data/rgbd/filinha", options)
    assert len(source.pairs) == 108
    assert source.registration is not None
    shifts = np.arange(-12, 13)
    score = np.zeros(len(shifts))
    for pair in source.pairs[3::12]:
        grey = np.asarray(cv2.imread(str(pair.colour), cv2.IMREAD_GRAYSCALE), np.uint8)
        gradient = np.minimum(np.abs(cv2.Sobel(grey, cv2.CV_32F, 1, 0)), 200)
        depth = scipy.io.loadmat(pair.depth)["depth_array"]
        metres = cv2.medianBlur(source.registration(depth), 3) / 1000.0
        for side in (-1, 1):  # the body is near; the wall six pixels farther out is far
            outside, next_to = np.roll(metres, side * 6, 1), np.roll(metres, side, 1)
            outline = (metres > 0) & (outside > metres + 0.4)
            outline &= ~((next_to > 0) & (next_to < metres + 0.4))
            v, u = np.nonzero(outline[:, 20:-20])
            score += [gradient[v, u + 20 + shift].sum() for shift in shifts]
    assert abs(shifts[np.argmax(score)]) <= 1


def test_calibration_file_in_the_documentation(tmp_path: Path) -> None:
    text = (ROOT / "docs/cameras/cameras.md").read_text("utf-8")
    begin = text.index("\ntranslation_m =")
    file = tmp_path / "camera.toml"
    file.write_text(text[begin : text.index("\n```", begin)])
    calibration = read_calibration(file)
    assert calibration.colour is not None
    assert calibration.depth is not None
    assert (calibration.colour.fx, calibration.depth.fx) == (534.3, 567.9)
    assert calibration.depth_offset_px == (9, 3)


def test_a_list_does_not_lead_out_of_its_folder(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    put(tmp_path / "secret.png", 1, depth=False)
    put(folder / "depth/a.png", 10_000, depth=True)
    (folder / "link.png").symlink_to("../secret.png")
    (folder / "depth.txt").write_text("1.0 depth/a.png\n")
    for name in ("../secret.png", str(tmp_path / "secret.png"), "link.png", "depth/../../x"):
        (folder / "rgb.txt").write_text(f"1.0 {name}\n")
        with pytest.raises(SourceError, match=r"leads out of the folder.*Copy the file"):
            FolderSource(folder, FolderOptions())


def test_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    folder = numbered(tmp_path / "folder", (1, 2))
    put(tmp_path / "secret.png", 1, depth=False)
    (folder / "rgb/frame_2.png").unlink()
    (folder / "rgb/frame_2.png").symlink_to("../../secret.png")
    with pytest.raises(SourceError, match="leads out of the folder"):
        FolderSource(folder, FolderOptions())
    with pytest.raises(SourceError, match="expected one below the folder"):
        FolderSource(folder, FolderOptions(colour="../*.png", depth="depth/*"))


def test_a_time_that_no_stamp_can_hold_is_refused(tmp_path: Path) -> None:
    folder = numbered(tmp_path, (0, 1))
    for times_s in ([0.0, 1e300], [0.0, np.nan], [[0.0, 1.0]]):
        np.savez(folder / "gt.npz", t=np.array(times_s))
        with pytest.raises(SourceError, match="times: expected"):
            FolderSource(folder, FolderOptions())
    (folder / "gt.npz").unlink()
    (folder / "rgb.txt").write_text("99999999999999999999.0 rgb/frame_0.png\n")
    (folder / "depth.txt").write_text("99999999999999999999.0 depth/d000000.png\n")
    with pytest.raises(SourceError, match="expected a time"):
        FolderSource(folder, FolderOptions())


def test_pipe_or_huge_image_is_counted_as_bad(tmp_path: Path) -> None:
    folder = numbered(tmp_path, (1, 2, 3, 4))
    source = FolderSource(folder, FolderOptions())
    (folder / "rgb/frame_2.png").unlink()
    os.mkfifo(folder / "rgb/frame_2.png")
    (folder / "rgb/frame_3.png").write_bytes(b"P6 60000 60000 255\n")
    with (folder / "depth/d000004.png").open("wb") as file:
        file.truncate(2**33)
    assert len(captures(source)) == 1
    assert source.counters["bad_images"] == 3


def test_a_calibration_with_aliases_is_refused(tmp_path: Path) -> None:
    # Each line repeats the line before ten times: a kilobyte would be a list of 10^9 numbers.
    lines = ["a0: &a0 [1,1,1,1,1,1,1,1,1,1]"]
    lines += [f"a{k}: &a{k} [{','.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 9)]
    (tmp_path / "camera_info.yaml").write_text("\n".join([*lines, "camera_matrix: {data: *a8}"]))
    with pytest.raises(SourceError, match="it has aliases"):
        read_calibration(tmp_path / "camera_info.yaml")
    (tmp_path / "camera_info.yaml").write_text("!!python/object/apply:os.system ['true']")
    with pytest.raises(SourceError, match="could not determine a constructor"):
        read_calibration(tmp_path / "camera_info.yaml")
