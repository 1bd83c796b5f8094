"""Sizes in image headers, checked before a decoder trusts the file."""

import re
import struct
import zlib

import cv2
import numpy as np
import pytest

from common.io.image_header import MAX_PACKED, MAX_SCANS, image_size
from people4d.errors import DecodeError

PIXELS = np.random.default_rng(0).integers(0, 255, (6, 11, 3), np.uint8)


def encoded(ending: str, *settings: int, grey: bool = False) -> bytes:
    _, data = cv2.imencode(ending, PIXELS[..., 0] if grey else PIXELS, settings)
    return data.tobytes()


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def with_chunks(*chunks: bytes) -> bytes:
    png = encoded(".png")
    return png[:33] + b"".join(chunks) + png[33:]


def tiff(*entries: tuple[int, int, int]) -> bytes:
    """Return the head of a TIFF, highest byte first, with entries of tag, type and value."""
    body = b"".join(struct.pack(">HHII", tag, kind, 1, value) for tag, kind, value in entries)
    return b"MM\0*" + struct.pack(">IH", 8, len(entries)) + body


@pytest.mark.parametrize("ending", [".jpg", ".png", ".tif", ".bmp", ".ppm", ".pgm"])
def test_sizes_are_those_of_the_decoder(ending: str) -> None:
    data = encoded(ending, grey=ending == ".pgm")
    assert image_size(data) == (11, 6)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert image.shape[:2] == (6, 11)


def test_progressive_and_commented_images_are_accepted() -> None:
    assert image_size(encoded(".jpg", cv2.IMWRITE_JPEG_PROGRESSIVE, 1)) == (11, 6)
    assert image_size(b"P5 # a comment\n# and another\n 11 6\n255\n" + bytes(66)) == (11, 6)
    assert image_size(with_chunks(chunk(b"tEXt", b"Title\0x"))) == (11, 6)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "expected JPEG, PNG"),
        (b"GIF89a" + bytes(100), "expected JPEG, PNG"),
        (b"II*\0" + bytes(100), "a truncated one"),
        (b"II*\0\xff\xff\xff\xff" + bytes(100), "a truncated one"),
        (tiff((256, 4, 50_000), (257, 4, 50_000)), "got 50000x50000"),
        (tiff((256, 4, 9), (257, 4, 9), (322, 4, 9)), "got one in tiles"),
        (b"P6 99999 99999 255\n", "got 99999x99999"),
        (b"P5" + b"#\n" * 10_000, "got a corrupt one"),
        (b"BM" + bytes(12) + struct.pack("<Iii", 40, 50_000, -50_000), "got 50000x50000"),
        (b"BM" + bytes(12) + struct.pack("<Iii", 40, -5, 5), "got -5x5"),
        (b"P5 4000 4000 255\n", "4000x4000 pixels cannot be in 17 bytes"),
        (b"\xff\xd8" + b"\xff" * 10**6, "got a corrupt one"),
        (b"\xff\xd8" + b"\xff\xe0\0\2" * 10**6, "got a corrupt one"),
        (encoded(".jpg") + b"\xff\xda" * MAX_SCANS, "scans"),
        (
            re.sub(rb"....IDAT", b"\x30\0\0\0IDAT", encoded(".png"), flags=re.DOTALL),
            "a truncated one",
        ),
        (with_chunks(chunk(b"acTL", struct.pack(">II", 9, 0))), "animated"),
        (with_chunks(*[chunk(b"zTXt", b"a\0\0")] * (MAX_PACKED + 1)), "many texts"),
        (encoded(".png")[:33] + chunk(b"tEXt", b"") * 70_000, "many texts or pieces"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_files_that_would_cost_too_much_are_refused(data: bytes, message: str) -> None:
    with pytest.raises(DecodeError, match=message):
        image_size(data)


@pytest.mark.parametrize("ending", [".jpg", ".png"])
def test_uniform_images_pass_the_size_limit(ending: str) -> None:
    plain = np.zeros((1024, 2048, 3), np.uint8)
    best = (cv2.IMWRITE_PNG_COMPRESSION, 9) if ending == ".png" else (cv2.IMWRITE_JPEG_QUALITY, 1)
    settings = [*best, cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    data = cv2.imencode(ending, plain, settings if ending == ".jpg" else best)[1].tobytes()
    assert image_size(data) == (2048, 1024)
    grey = cv2.imencode(ending, plain[..., 0], best)[1].tobytes()
    assert image_size(grey) == (2048, 1024)
