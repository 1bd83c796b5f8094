"""Encodings of sensor_msgs images."""

import dataclasses
import struct
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from people4d.errors import DecodeError
from services.camera.ros.images import colour_image, depth_image, millimetres
from tests.camera.ros.bags import SIZE, Ros, compressed_depth, depth_mm, rgb

ROS = Ros(2)


def with_alpha(image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    return np.dstack([image, np.full(image.shape[:2], 255, np.uint8)])


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", rgb(7)),
        ("bgr8", rgb(7)[..., ::-1]),
        ("rgba8", with_alpha(rgb(7))),
        ("bgra8", with_alpha(rgb(7)[..., ::-1].copy())),
    ],
)
def test_colour_encodings_give_red_first(
    encoding: str, pixels: npt.NDArray[np.uint8], padding: int
) -> None:
    image = colour_image(ROS.image(pixels, encoding, padding=padding))
    assert image.flags.c_contiguous
    assert np.array_equal(image, rgb(7))


def test_mono_is_spread_over_three_channels() -> None:
    grey = rgb()[..., 1]
    image = colour_image(ROS.image(grey, "mono8", padding=3))
    assert np.array_equal(image, np.dstack([grey] * 3))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("padding", [0, 6])
def test_depth_in_millimetres_of_either_byte_order(order: str, padding: int) -> None:
    pixels = depth_mm(3001).astype(f"{order}u2")
    assert np.array_equal(depth_image(ROS.image(pixels, "16UC1", padding=padding)), depth_mm(3001))


@pytest.mark.parametrize("order", ["<", ">"])
def test_depth_in_metres_without_reading_is_zero(order: str) -> None:
    # 1.2344 m = 1234.4 mm -> 1234; NaN, infinite, negative and beyond 65.535 m -> 0.
    metres = np.array([[1.2344, 1.2346, np.nan, np.inf, -np.inf, -1, 0, 65.535, 65.6]])
    pixels = metres.astype(f"{order}f4")
    image = depth_image(ROS.image(pixels, "32FC1"))
    assert image.tolist() == [[1234, 1235, 0, 0, 0, 0, 0, 65535, 0]]


def test_jpeg_and_png_colour() -> None:
    _, png = cv2.imencode(".png", rgb(7)[..., ::-1])
    assert np.array_equal(colour_image(ROS.compressed(png.tobytes(), "rgb8; png")), rgb(7))
    plain = np.full((16, 16, 3), (10, 200, 30), np.uint8)
    _, jpeg = cv2.imencode(".jpg", plain[..., ::-1])
    found = colour_image(ROS.compressed(jpeg.tobytes(), "rgb8; jpeg compressed bgr8"))
    assert np.abs(found.astype(int) - plain).max() < 8


def test_compressed_depth_in_millimetres() -> None:
    data = compressed_depth(depth_mm(2500), 0.0, 0.0)
    found = depth_image(ROS.compressed(data, "16UC1; compressedDepth png"))
    assert np.array_equal(found, depth_mm(2500))
    _, png = cv2.imencode(".png", depth_mm(2500))
    found = depth_image(ROS.compressed(png.tobytes(), "16UC1; png compressed "))
    assert np.array_equal(found, depth_mm(2500))


def test_compressed_depth_in_metres_is_quantised_inversely() -> None:
    # compressed_depth_image_transport: inverse = a / depth + b, so depth = a / (inverse - b).
    # a = 2000, b = -100: inverse 900 is 2000 / 1000 = 2 m, inverse 400 is 2000 / 500 = 4 m.
    inverse = np.array([[0, 900, 400]], np.uint16)
    data = compressed_depth(inverse, 2000.0, -100.0)
    found = depth_image(ROS.compressed(data, "32FC1; compressedDepth"))
    assert found.tolist() == [[0, 2000, 4000]]


@pytest.mark.parametrize("depth", [np.uint16(1234), np.float32(1.234)])
def test_compressed_depth_as_tiff(depth: np.generic) -> None:
    _, tiff = cv2.imencode(".tif", np.full((2, 3), depth))
    found = depth_image(ROS.compressed(tiff.tobytes(), "16UC1; tiff compressed"))
    assert found.tolist() == [[1234] * 3] * 2


# Two zeros, two numbers (5, then 1 more: folded 10 and 2), two zeros, no number; three bits in each
# nibble, lowest first, 8: one more nibble; the highest nibble of a word of 32 bits comes first.
RVL = struct.pack("<iiI", 3, 2, 0x22A12200)


def test_compressed_depth_as_rvl() -> None:
    found = depth_image(ROS.compressed(bytes(12) + RVL, "16UC1; compressedDepth rvl"))
    assert found.tolist() == [[0, 0, 5], [6, 0, 0]]
    # 1000 / (5 + 15) = 50 m, 1000 / (6 + 15) = 47.619 m
    header = struct.pack("<iff", 0, 1000.0, -15.0)
    found = depth_image(ROS.compressed(header + RVL, "32FC1; compressedDepth rvl"))
    assert found.tolist() == [[0, 0, 50000], [47619, 0, 0]]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "expected a size in 8 bytes, got 0"),
        (struct.pack("<ii", -3, -2) + RVL[8:], "got -3x-2"),
        (struct.pack("<ii", 2**30, 2**30), "got 1073741824x1073741824"),
        (RVL[:8], "a corrupt image"),
        (struct.pack("<ii", 3, 1) + RVL[8:], "a corrupt image"),  # more pixels than its size
        (struct.pack("<ii", 9, 9) + RVL[8:], "a corrupt image"),  # fewer
        (RVL[:8] + b"\xff" * 8, "a corrupt image"),  # a number without end
    ],
)
def test_corrupt_rvl_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(DecodeError, match=message):
        depth_image(ROS.compressed(bytes(12) + data, "16UC1; compressedDepth rvl"))


def cut(message: Any) -> Any:
    return dataclasses.replace(message, data=message.data[:-1])


def test_bad_images_are_refused_with_expected_and_got() -> None:
    with pytest.raises(DecodeError, match="expected 144 bytes, got 143"):
        colour_image(cut(ROS.image(rgb(), "rgb8")))
    with pytest.raises(DecodeError, match=r"expected rows of 24 bytes, got 6 of 16"):
        colour_image(ROS.image(depth_mm(), "rgb8"))
    with pytest.raises(DecodeError, match="got 'bayer_rggb8'"):
        colour_image(ROS.image(rgb(), "bayer_rggb8"))
    with pytest.raises(DecodeError, match="expected encoding 16UC1"):
        depth_image(ROS.image(rgb(), "rgb8"))
    for data in (b"", b"\xff\xd8\xff junk", b"\x89PNG\r\n\x1a\n"):
        with pytest.raises(DecodeError, match="corrupt"):
            colour_image(ROS.compressed(data, "jpeg"))
    with pytest.raises(DecodeError, match="expected PNG, TIFF or RVL, got 'jpeg'"):
        depth_image(ROS.compressed(b"\xff\xd8\xff junk", "jpeg"))
    _, png = cv2.imencode(".png", rgb())
    with pytest.raises(DecodeError, match="expected 16 bits grey"):
        depth_image(ROS.compressed(png.tobytes(), "16UC1; png"))


def test_last_row_may_lack_its_padding() -> None:
    message = ROS.image(depth_mm(), "16UC1", padding=1)
    assert np.array_equal(depth_image(cut(message)), depth_mm())


def test_millimetres_leaves_its_input_alone() -> None:
    metres = np.full(SIZE, np.nan, np.float32)
    metres.setflags(write=False)
    assert not millimetres(metres).any()


@pytest.mark.parametrize(
    ("encoding", "pair"), [("yuv422", (128, 90)), ("uyvy", (128, 90)), ("yuv422_yuy2", (90, 128))]
)
def test_colour_with_shared_chroma_is_read(encoding: str, pair: tuple[int, int]) -> None:
    # Luma 90 of 16 to 235 without chroma is a grey of (90 - 16) * 255 / 219 = 86.
    pixels = np.full((6, 8, 2), pair, np.uint8)
    rgb = colour_image(Ros(2).image(pixels, encoding))
    assert rgb.shape == (6, 8, 3)
    assert np.abs(rgb.astype(int) - 86).max() <= 1
