"""RGB-D frames to and from JPEG (colour) and 16-bit PNG (depth)."""

import struct
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from common.io.image_header import JPEG, PNG, image_size
from people4d.errors import DecodeError
from people4d.messages import U8, U16, CompressedRgbdFrame, RgbdFrame


def compress(frame: RgbdFrame, quality: int = 90) -> CompressedRgbdFrame:
    """Compress a frame with a JPEG quality of 1 to 100; depth is lossless."""
    return CompressedRgbdFrame(
        stamp_ns=frame.stamp_ns,
        sequence=frame.sequence,
        trace=frame.trace,
        camera=frame.camera,
        rgb_jpeg=encode_jpeg(frame.rgb, quality),
        depth_png=encode_png16(frame.depth_mm),
    )


def decompress(message: CompressedRgbdFrame) -> RgbdFrame:
    """Return the frame with its pixels; DecodeError if an image is corrupt, too large or unfit."""
    rgb = decode_jpeg(message.rgb_jpeg)
    depth_mm = decode_png16(message.depth_png)
    if rgb.shape[:2] != depth_mm.shape:
        raise DecodeError(
            f"frame {message.sequence} of {message.camera}: expected depth as large as colour "
            f"({_size(rgb)}), got {_size(depth_mm)}"
        )
    return RgbdFrame(
        stamp_ns=message.stamp_ns,
        sequence=message.sequence,
        trace=message.trace,
        camera=message.camera,
        rgb=rgb,
        depth_mm=depth_mm,
    )


def encode_jpeg(rgb: U8, quality: int = 90) -> bytes:
    """Encode an image (HxWx3, red first) as JPEG of a quality from 1 to 100."""
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return data.tobytes()


def encode_png16(depth_mm: U16, level: int = 1, smooth: bool = False) -> bytes:
    """Encode depth (HxW) as 16-bit PNG; levels 0 to 9 trade time for size.

    Smooth depth has no noise, as in a simulation: the filter "up" makes its file a third smaller,
    but not with a sensor's noise.
    """
    row_filter = cv2.IMWRITE_PNG_FILTER_UP if smooth else cv2.IMWRITE_PNG_FILTER_NONE
    settings = [cv2.IMWRITE_PNG_COMPRESSION, level, cv2.IMWRITE_PNG_FILTER, row_filter]
    _, data = cv2.imencode(".png", depth_mm, settings)
    return data.tobytes()


def decode_jpeg(data: bytes) -> U8:
    """Return the pixels of an untrusted JPEG, HxWx3, red first; DecodeError if it is corrupt."""
    if not data.startswith(JPEG):
        raise DecodeError("rgb_jpeg: expected a JPEG, got a corrupt one")
    width, height = image_size(data, "rgb_jpeg")
    # OpenCV fills a truncated JPEG with grey; only the missing end marker shows it. Some files are
    # padded.
    complete = b"\xff\xd9" in data[-256:]
    rgb = _decode(data, cv2.IMREAD_COLOR_RGB) if complete else None
    if rgb is None or rgb.shape != (height, width, 3):
        raise DecodeError("rgb_jpeg: expected a complete JPEG, got a corrupt one")
    return np.asarray(rgb, np.uint8)


def decode_png16(data: bytes) -> U16:
    """Return the depth of an untrusted 16-bit PNG, HxW, millimetres; DecodeError if it is bad."""
    if not data.startswith(PNG):
        raise DecodeError("depth_png: expected a PNG, got a corrupt one")
    width, height = image_size(data, "depth_png")
    bits, colour = struct.unpack_from(">BB", data, 24)
    if (bits, colour) != (16, 0):
        raise DecodeError(
            f"depth_png: expected 16 bits grey, got {bits} bits, colour type {colour}",
            "Record depth as 16-bit millimetres.",
        )
    depth = _decode(data, cv2.IMREAD_UNCHANGED) if b"IEND" in data[-64:] else None
    if depth is None or depth.shape != (height, width) or depth.dtype != np.uint16:
        raise DecodeError("depth_png: expected a complete PNG, got a corrupt one")
    return np.asarray(depth, np.uint16)


def decode_image(data: bytes, flags: int, name: str = "image") -> npt.NDArray[Any]:
    """Return the pixels of an untrusted file as OpenCV decodes it; DecodeError if it is corrupt."""
    image_size(data, name)
    image = _decode(data, flags)
    if image is None:
        raise DecodeError(f"{name}: expected a JPEG or PNG file, got a corrupt one")
    return image


def _decode(data: bytes, flags: int) -> "cv2.typing.MatLike | None":
    # The orientation tag is ignored: depth and calibration are in the sensor's pixels.
    flags |= cv2.IMREAD_IGNORE_ORIENTATION
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        return None


def _size(image: U8 | U16) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"
