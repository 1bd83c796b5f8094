"""JPEG and PNG of frames: exact depth, close colour, and invalid files."""

import struct
import zlib

import cv2
import numpy as np
import pytest

from common.io.images import (
    compress,
    decode_jpeg,
    decode_png16,
    decompress,
    encode_jpeg,
    encode_png16,
)
from people4d.errors import DecodeError
from people4d.messages import U8, U16, CompressedRgbdFrame, RgbdFrame, Span


def colours(width: int = 64, height: int = 48) -> U8:
    """A smooth image, as JPEG likes it, with more red on the right and more green below."""
    u, v = np.meshgrid(np.linspace(0, 200, width), np.linspace(0, 100, height))
    return np.dstack([u, v, np.full_like(u, 50)]).astype(np.uint8)


def depths(width: int = 64, height: int = 48) -> U16:
    return np.random.default_rng(0).integers(0, 65536, (height, width), np.uint16)


def frame() -> RgbdFrame:
    span = Span(stage="camera.read", process="camera@host", start_ns=1, end_ns=2)
    return RgbdFrame(
        stamp_ns=7, sequence=3, trace=(span,), camera="front", rgb=colours(), depth_mm=depths()
    )


def pair(rgb_jpeg: bytes, depth_png: bytes) -> CompressedRgbdFrame:
    return CompressedRgbdFrame(
        stamp_ns=0, sequence=0, camera="front", rgb_jpeg=rgb_jpeg, depth_png=depth_png
    )


def test_depth_without_noise_is_smaller_as_differences_and_as_exact() -> None:
    # A slope: each row is 10 mm farther than the row above.
    slope = (1000 + 10 * np.arange(48)[:, None] + np.arange(64) ** 2 % 97).astype(np.uint16)
    plain, smooth = encode_png16(slope), encode_png16(slope, smooth=True)
    assert len(smooth) < 0.7 * len(plain)
    for png in (plain, smooth):
        assert np.array_equal(decode_png16(png), slope)


def test_round_trip() -> None:
    sent = frame()
    got = decompress(compress(sent, quality=95))
    assert (got.stamp_ns, got.sequence, got.camera, got.trace) == (7, 3, "front", sent.trace)
    np.testing.assert_array_equal(got.depth_mm, sent.depth_mm)
    assert np.abs(got.rgb.astype(int) - sent.rgb.astype(int)).max() <= 8
    assert got.rgb.flags["C_CONTIGUOUS"]


def test_red_stays_red() -> None:
    red = np.zeros((16, 16, 3), np.uint8)
    red[..., 0] = 255
    assert decode_jpeg(encode_jpeg(red))[8, 8].argmax() == 0


def test_sizes_must_agree() -> None:
    with pytest.raises(DecodeError, match="as large as colour \\(64x48\\), got 32x48"):
        decompress(pair(encode_jpeg(colours()), encode_png16(depths(32, 48))))


@pytest.mark.parametrize("length", [4, 100, 0.5, 0.95])
def test_cut_files(length: float) -> None:
    jpeg, png = encode_jpeg(colours()), encode_png16(depths())
    with pytest.raises(DecodeError, match="rgb_jpeg"):
        decode_jpeg(jpeg[: int(length if length > 1 else length * len(jpeg))])
    with pytest.raises(DecodeError, match="depth_png"):
        decode_png16(png[: int(length if length > 1 else length * len(png))])


def test_damaged_pixels_of_a_png() -> None:
    png = bytearray(encode_png16(depths()))
    png[len(png) // 2] ^= 0xFF
    with pytest.raises(DecodeError, match="depth_png"):
        decode_png16(bytes(png))


def test_junk_behind_the_signatures() -> None:
    for seed in range(50):
        junk = np.random.default_rng(seed).bytes(400)
        with pytest.raises(DecodeError):
            decode_jpeg(b"\xff\xd8\xff" + junk)
        with pytest.raises(DecodeError):
            decode_png16(b"\x89PNG\r\n\x1a\n" + junk)


@pytest.mark.parametrize(
    ("image", "got"),
    [
        (np.zeros((4, 4), np.uint8), "8 bits, colour type 0"),
        (np.zeros((4, 4, 3), np.uint16), "16 bits, colour type 2"),
    ],
)
def test_depth_has_16_bits_and_no_colour(image: U8 | U16, got: str) -> None:
    data = cv2.imencode(".png", image)[1].tobytes()
    with pytest.raises(DecodeError, match=got):
        decode_png16(data)


def test_hostile_sizes_are_refused_before_pixels_are_allocated() -> None:
    header = struct.pack(">IIBBBBB", 100_000, 100_000, 16, 0, 0, 0, 0)
    chunk = b"IHDR" + header
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk
    png += struct.pack(">I", zlib.crc32(chunk))
    with pytest.raises(DecodeError, match="got 100000x100000"):
        decode_png16(png)
    jpeg = encode_jpeg(colours())
    at = jpeg.index(b"\xff\xc0") + 5  # marker, length (2), precision (1), height (2), width (2)
    with pytest.raises(DecodeError, match="got 65535x65535"):
        decode_jpeg(jpeg[:at] + b"\xff\xff\xff\xff" + jpeg[at + 4 :])


def test_a_grey_jpeg_is_an_image_of_three_equal_channels() -> None:
    grey = cv2.imencode(".jpg", np.full((8, 8), 90, np.uint8))[1].tobytes()
    assert decode_jpeg(grey)[4, 4].tolist() == [90, 90, 90]
