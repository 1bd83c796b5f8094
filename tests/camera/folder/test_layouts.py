"""Folders in the layouts of other recorders."""

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from common.io.images import decode_jpeg, encode_jpeg
from people4d.errors import SourceError
from services.camera.calibration import read_calibration
from services.camera.folder.source import FolderOptions, FolderSource
from tests.camera.folder.test_folder import LENS, captures, numbered, put

MATRIX = [[10.0, 0.0, 4.0], [0.0, 10.0, 3.0], [0.0, 0.0, 1.0]]


def stamps(folder: Path) -> list[int]:
    return [frame.stamp_ns for frame in captures(FolderSource(folder, FolderOptions()))]


def tagged(jpeg: bytes, orientation: int) -> bytes:
    """Return a JPEG with an EXIF tag of its orientation."""
    entry = struct.pack("<IHHHIII", 8, 1, 0x0112, 3, 1, orientation, 0)
    body = b"Exif\0\0II*\0" + entry
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body + jpeg[2:]


@pytest.mark.parametrize("orientation", [3, 6])
def test_orientation_tag_does_not_turn_colour_against_depth(
    tmp_path: Path, orientation: int
) -> None:
    pixels = np.zeros((6, 8, 3), np.uint8)
    pixels[:2, :2] = 255
    jpeg = tagged(encode_jpeg(pixels, 95), orientation)
    assert decode_jpeg(jpeg)[0, 0].min() > 200  # in recordings, too
    folder = numbered(tmp_path, (1,))
    (folder / "rgb/frame_1.png").unlink()
    (folder / "rgb/frame_1.jpg").write_bytes(jpeg)
    (frame,) = captures(FolderSource(folder, FolderOptions()))
    assert frame.rgb.shape == (6, 8, 3)
    assert frame.rgb[0, 0].min() > 200
    assert frame.rgb[-1, -1].max() < 50


@pytest.mark.parametrize(
    ("names", "times_ns"),
    [
        # TUM: sorted by the fraction alone the order would differ, and equal fractions would
        # collide.
        (("1305031102.9", "1305031103.1", "1305031104.1"), (102_900, 103_100, 104_100)),
        (("1305031102_900000000", "1305031103_100000000"), (102_900, 103_100)),
        (("c_1305031102.900000", "c_1305031103.100000"), (102_900, 103_100)),
        (("1305031102900", "1305031103100"), (102_900, 103_100)),
        (("1305031102900000", "1305031103100000"), (102_900, 103_100)),
        (("1305031102900000000", "1305031103100000000"), (102_900, 103_100)),
    ],
)
def test_names_that_are_times_give_the_stamps(
    tmp_path: Path, names: tuple[str, ...], times_ns: tuple[int, ...]
) -> None:
    for name in names:
        put(tmp_path / f"rgb/{name}.png", 1, depth=False)
        put(tmp_path / f"depth/{name}.png", 1000, depth=True)
    (tmp_path / "camera.json").write_text(json.dumps(LENS))
    assert stamps(tmp_path) == [1305031000 * 10**9 + ms * 10**6 for ms in times_ns]


def test_names_that_are_times_of_two_clocks_pair_by_nearness(tmp_path: Path) -> None:
    for colour, depth in (("5.000", "5.010"), ("5.100", "5.090"), ("5.200", "5.290")):
        put(tmp_path / f"rgb/{colour}.png", 1, depth=False)
        put(tmp_path / f"depth/{depth}.png", 1000, depth=True)
    (tmp_path / "camera.json").write_text(json.dumps(LENS))
    assert stamps(tmp_path) == [5_000_000_000, 5_100_000_000]


def test_two_files_of_one_number_are_refused(tmp_path: Path) -> None:
    folder = numbered(tmp_path)
    put(folder / "rgb/other_2.png", 1, depth=False)
    with pytest.raises(SourceError, match=r"frame_2.png and other_2.png have the same number"):
        FolderSource(folder, FolderOptions())


def test_depth_of_another_size_without_a_calibration_is_refused(tmp_path: Path) -> None:
    folder = numbered(tmp_path)
    for path in (folder / "depth").iterdir():
        cv2.imwrite(str(path), np.full((3, 4), 1000, np.uint16))
    with pytest.raises(SourceError, match=r"depth is 4x3, colour 8x6.*calibration file"):
        FolderSource(folder, FolderOptions())
    lens = {"fx": 5.0, "fy": 5.0, "cx": 2.0, "cy": 1.5}
    (folder / "camera.json").write_text(json.dumps({"colour": LENS, "depth": lens}))
    assert captures(FolderSource(folder, FolderOptions()))[0].depth_mm.shape == (6, 8)


def test_most_common_size_counts_not_the_first(tmp_path: Path) -> None:
    folder = numbered(tmp_path)
    cv2.imwrite(str(folder / "depth/d000001.png"), np.full((3, 4), 1000, np.uint16))
    source = FolderSource(folder, FolderOptions())
    assert source.registration is None
    assert len(captures(source)) == 3  # the first is rejected by its size later


@pytest.mark.parametrize("depth", [np.uint16(1234), np.float32(1.234)])
def test_depth_as_tiff_is_read(tmp_path: Path, depth: np.generic) -> None:
    folder = numbered(tmp_path, (1,))
    (folder / "depth/d000001.png").unlink()
    cv2.imwrite(str(folder / "depth/d000001.tiff"), np.full((6, 8), depth))
    (frame,) = captures(FolderSource(folder, FolderOptions()))
    assert (frame.depth_mm == 1234).all()


def test_depth_as_npy_is_read(tmp_path: Path) -> None:
    folder = numbered(tmp_path, (1,))
    (folder / "depth/d000001.png").unlink()
    np.save(folder / "depth/d000001.npy", np.full((6, 8), 1234, np.uint16))
    (frame,) = captures(FolderSource(folder, FolderOptions()))
    assert (frame.depth_mm == 1234).all()
    np.save(folder / "depth/d000001.npy", np.full((6, 8), 1234, np.int32))
    with pytest.raises(SourceError, match=r"expected 16 bits grey, got int32.*millimetres"):
        FolderSource(folder, FolderOptions())
    np.save(folder / "depth/d000001.npy", np.array([{}]), allow_pickle=True)
    with pytest.raises(SourceError, match="not a readable image: array"):
        FolderSource(folder, FolderOptions())


@pytest.mark.parametrize("name", ["depth/d000001.exr", "rgb.mp4"])
def test_kinds_of_files_that_are_not_read_are_named(tmp_path: Path, name: str) -> None:
    folder = numbered(tmp_path, (1,))
    (folder / "depth/d000001.png").unlink()
    (folder / name).write_bytes(b"")
    with pytest.raises(SourceError, match=rf"{name} is of a kind that is not read.*PNG"):
        FolderSource(folder, FolderOptions())


def test_colour_and_depth_in_one_folder_pair_by_their_names(tmp_path: Path) -> None:
    for k in (0, 1):
        put(tmp_path / f"frame-{k:06d}.color.png", k, depth=False)
        put(tmp_path / f"frame-{k:06d}.depth.png", 1000 + k, depth=True)
    (tmp_path / "camera.json").write_text(json.dumps(LENS))
    assert stamps(tmp_path) == [0, 33_333_333]


def column_major(matrix: list[list[float]]) -> list[float]:
    return [value for column in zip(*matrix, strict=True) for value in column]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (
            "camera_intrinsic.json",
            json.dumps({"width": 8, "height": 6, "intrinsic_matrix": column_major(MATRIX)}),
        ),
        ("camera_matrix.csv", "10.0, 0, 4\n0, 10, 3\n0, 0, 1\n"),
        ("camera-intrinsics.txt", "10 0 4 0\n0 10 3 0\n0 0 1 0\n0 0 0 1\n"),
    ],
)
def test_camera_matrices_of_other_recorders_are_found_and_read(
    tmp_path: Path, name: str, text: str
) -> None:
    folder = numbered(tmp_path)
    (folder / "camera.json").unlink()
    (folder / name).write_text(text)
    info = FolderSource(folder, FolderOptions()).info
    assert (info.fx, info.fy, info.cx, info.cy) == (10, 10, 4, 3)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", '{"width": 8, "f": 3}', "expected fx, fy, cx and cy"),
        ("a.txt", "1 2 3", "3x3 or 4x4, got 3 numbers"),
        ("a.csv", "1,2,3,4,5,6,7,8,9", "third row"),
        (
            "a.yml",
            "image_width: 8\nimage_height: 6\ndistortion_model: ftheta\n"
            "camera_matrix: {data: [10, 0, 4, 0, 10, 3, 0, 0, 1]}\n"
            "distortion_coefficients: {data: [0.1, 0, 0, 0]}\n",
            "ftheta",
        ),
    ],
)
def test_calibration_of_another_kind_is_refused(
    tmp_path: Path, name: str, text: str, message: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(SourceError, match=message):
        read_calibration(tmp_path / name)
