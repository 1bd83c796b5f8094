"""Depth images compressed by RVL ("Fast Lossless Depth Image Compression" [Wilson 2017])."""

import struct

import numpy as np

from common.compiled import compiled
from people4d.errors import DecodeError
from people4d.messages import U8, U16
from people4d.messages.base import MAX_PIXELS

MAX_NIBBLES = 11  # maximum number of nibbles of a number of 32 bits
SIZE = struct.Struct("<ii")  # columns and rows


def decode_rvl(data: bytes) -> U16:
    """Return an untrusted depth image (HxW) of compressed_depth_image_transport's `rvl`.

    DecodeError if the bytes are too few or corrupt, or the image is too large.
    """
    if len(data) < SIZE.size:
        raise DecodeError(f"RVL: expected a size in {SIZE.size} bytes, got {len(data)}")
    width, height = SIZE.unpack_from(data)
    if not (0 < width <= MAX_PIXELS and 0 < height <= MAX_PIXELS // width):
        raise DecodeError(f"RVL: expected 1 to {MAX_PIXELS} pixels, got {width}x{height}")
    depth = np.zeros(width * height, np.uint16)
    if not _decode(np.frombuffer(data, np.uint8, offset=SIZE.size), depth):
        raise DecodeError(f"RVL: expected {width}x{height} pixels, got a corrupt image")
    return depth.reshape(height, width)


@compiled
def _decode(data: U8, depth: U16) -> bool:
    """Fill N pixels from runs of zeros and of differences; False if the bytes do not fit."""
    nibble, pixel, last = 0, 0, 0
    while pixel < len(depth):
        zeros, nibble = _number(data, nibble)
        count, nibble = _number(data, nibble)
        if nibble < 0 or pixel + zeros + count > len(depth) or zeros + count == 0:
            return False
        pixel += zeros
        for _ in range(count):
            folded, nibble = _number(data, nibble)
            if nibble < 0:
                return False
            last += (folded >> 1) ^ -(folded & 1)
            depth[pixel] = last & 0xFFFF
            pixel += 1
    return True


@compiled
def _number(data: U8, nibble: int) -> tuple[int, int]:
    """Return the number at a nibble, three bits in each, and the next nibble; -1: no bytes left."""
    value = 0
    for k in range(MAX_NIBBLES):
        # Words of 32 bits, lowest byte first, whose highest nibble comes first.
        byte_index = nibble // 8 * 4 + 3 - nibble % 8 // 2
        if nibble < 0 or byte_index >= len(data):
            return 0, -1
        byte = int(np.int64(data[byte_index]))
        bits = byte >> 4 if nibble % 2 == 0 else byte & 15
        value |= (bits & 7) << (3 * k)
        nibble += 1
        if bits & 8 == 0:
            return value, nibble
    return 0, -1
