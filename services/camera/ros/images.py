"""Images of sensor_msgs as numpy: colour as RGB, depth in millimetres."""

import struct
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from common.io.image_header import PNG, TIFF
from common.io.images import decode_image
from people4d.errors import DecodeError
from people4d.messages import U8, U16
from people4d.messages.base import MAX_PIXELS

# Encoding: numpy type of a channel, channels, conversion to RGB (None: it is RGB).
COLOURS: dict[str, tuple[str, int, int | None]] = {
    "rgb8": ("u1", 3, None),
    "bgr8": ("u1", 3, cv2.COLOR_BGR2RGB),
    "8UC3": ("u1", 3, cv2.COLOR_BGR2RGB),
    "rgba8": ("u1", 4, cv2.COLOR_RGBA2RGB),
    "bgra8": ("u1", 4, cv2.COLOR_BGRA2RGB),
    "8UC4": ("u1", 4, cv2.COLOR_BGRA2RGB),
    "yuv422": ("u1", 2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": ("u1", 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": ("u1", 2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": ("u1", 2, cv2.COLOR_YUV2RGB_YUY2),
    "mono8": ("u1", 1, cv2.COLOR_GRAY2RGB),
    "8UC1": ("u1", 1, cv2.COLOR_GRAY2RGB),
}
DEPTHS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
COMPRESSED_DEPTH_HEADER = struct.Struct("<iff")  # format, two parameters of the quantisation
PNG_HEADER_BYTES = 26  # [bytes] length of a PNG's header up to its bit depth and colour type
LOSSLESS = (PNG, *TIFF)
GREY16 = b"\x10\x00"  # 16 bits, grey


def colour_image(message: Any) -> U8:
    """Return an Image or CompressedImage as HxWx3, red first; DecodeError if it cannot be used."""
    if hasattr(message, "format"):
        bgr = decode_image(message.data.tobytes(), cv2.IMREAD_COLOR)
        return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)
    if message.encoding not in COLOURS:
        names = ", ".join(COLOURS)
        raise DecodeError(f"colour image: expected encoding {names}, got {message.encoding!r:.40}")
    kind, channels, conversion = COLOURS[message.encoding]
    pixels = _pixels(message, np.dtype(kind), channels)
    if conversion is None:
        return np.ascontiguousarray(pixels)
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels), conversion), np.uint8)


def encoding_of(message: Any) -> str:
    """Return the encoding of an Image or CompressedImage; empty if a compressed one has none."""
    if not hasattr(message, "format"):
        return str(message.encoding)
    encoding = str(message.format).partition(";")[0].strip()
    if encoding in DEPTHS or encoding in COLOURS:
        return encoding
    data = message.data[:PNG_HEADER_BYTES].tobytes()
    grey16 = data.startswith(PNG) and data[-2:] == GREY16
    return "16UC1" if grey16 else ""


def depth_image(message: Any) -> U16:
    """Return an Image or CompressedImage as HxW millimetres, 0 = no reading; or DecodeError."""
    if hasattr(message, "format"):
        return _compressed_depth(message.format, message.data.tobytes())
    if message.encoding not in DEPTHS:
        names = ", ".join(DEPTHS)
        raise DecodeError(f"depth image: expected encoding {names}, got {message.encoding!r:.40}")
    pixels = _pixels(message, np.dtype(DEPTHS[message.encoding]), 1)
    if message.encoding == "32FC1":
        return millimetres(pixels)
    return np.ascontiguousarray(pixels, np.uint16)


def millimetres(depth_m: npt.NDArray[Any]) -> U16:
    """Return metres (NaN or infinity = no reading) as millimetres (0 = no reading)."""
    # Not in place: the pixels may be read-only. Values beyond 16 bits are no readings.
    scaled = np.rint(np.asarray(depth_m, np.float32) * np.float32(1000))
    valid = (scaled > 0) & (scaled <= 65535)  # False for NaN
    return np.where(valid, scaled, 0).astype(np.uint16)


def _pixels(message: Any, kind: np.dtype[Any], channels: int) -> npt.NDArray[Any]:
    """View raw rows without their padding, HxW or HxWxC."""
    kind = kind.newbyteorder(">" if message.is_bigendian else "<")
    height, width, step = int(message.height), int(message.width), int(message.step)
    row_bytes = width * channels * kind.itemsize
    if not 0 < height * width <= MAX_PIXELS or step < row_bytes:
        raise DecodeError(f"image: expected rows of {row_bytes} bytes, got {height} of {step}")
    data = message.data
    # The last row may lack its padding.
    if len(data) < (height - 1) * step + row_bytes:
        raise DecodeError(f"image: expected {height * step} bytes, got {len(data)}")
    rows = np.lib.stride_tricks.as_strided(
        np.frombuffer(data, np.uint8), (height, row_bytes), (step, 1), writeable=False
    )
    pixels = np.ascontiguousarray(rows).view(kind)
    return pixels.reshape(height, width, channels) if channels > 1 else pixels


def _compressed_depth(layout: str, data: bytes) -> U16:
    """Decode PNG, TIFF or RVL, after the header of compressed_depth_image_transport if present."""
    has_header = "compressedDepth" in layout and not data.startswith(LOSSLESS)
    size = COMPRESSED_DEPTH_HEADER.size if has_header else 0
    if data[size:].startswith(LOSSLESS):
        depth = decode_image(data[size:], cv2.IMREAD_UNCHANGED)
    elif has_header and "rvl" in layout:
        from common.io.rvl import decode_rvl  # noqa: PLC0415  # loads the compiler

        depth = decode_rvl(data[size:])
    else:
        raise DecodeError(
            f"depth image: expected PNG, TIFF or RVL, got {layout!r:.60}",
            "Record depth raw or as PNG: JPEG loses depth.",
        )
    if depth.ndim == 2 and depth.dtype == np.float32:
        return millimetres(depth)
    if depth.dtype != np.uint16 or depth.ndim != 2:
        raise DecodeError(f"depth image: expected 16 bits grey, got {depth.dtype} {depth.shape}")
    if not (has_header and layout.startswith("32FC1")):
        return np.asarray(depth, np.uint16)
    _, a, b = COMPRESSED_DEPTH_HEADER.unpack(data[:size])
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_m = np.float32(a) / (depth.astype(np.float32) - np.float32(b))
    return millimetres(np.where(depth == 0, np.float32(np.nan), depth_m))
