"""Numbers from untrusted MATLAB files (version 5 to 7).

SciPy's reader allocates the declared size before reading, and crashes on some damaged files. Here a
matrix without all of its bytes is rejected.

Source: MAT-File Format, The MathWorks, level 5.
"""

import math
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from common.io.files import read_bytes

MAX_BYTES = 64 * 2**20  # [bytes] maximum size of the file and of its unpacked contents
MAX_DEPTH = 8  # maximum depth of nested structures
HEADER_BYTES = 128
MATRIX, PACKED = 14, 15  # types of data elements
STRUCT = 2  # class of a matrix
COMPLEX = 0x08  # flag of a matrix
# numpy types by type of data element, and by class of a matrix.
STORED = dict(enumerate(("i1", "u1", "i2", "u2", "i4", "u4", "f4"), start=1))
STORED |= {9: "f8", 12: "i8", 13: "u8"}
CLASSES = dict(enumerate(("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"), start=6))

Value: TypeAlias = npt.NDArray[Any] | dict[str, Any]
_TAG = struct.Struct("<II")


def read_mat(path: Path) -> Mapping[str, Value]:
    """Read arrays of numbers, and structures of arrays as mappings; other content is skipped.

    OSError if the file cannot be read, or is too large; ValueError if it is not a MATLAB file, or
    is damaged.
    """
    data = read_bytes(path, MAX_BYTES)
    if len(data) < HEADER_BYTES or data[124:128] != b"\x00\x01IM":
        raise ValueError("it is no MATLAB file of version 5 to 7")
    found: dict[str, Value] = {}
    budget = MAX_BYTES
    for kind, body in _elements(data[HEADER_BYTES:]):
        inner = [(kind, body)]
        if kind == PACKED:
            body = _unpacked(body, budget)
            budget -= len(body)
            inner = list(_elements(body))
        for kind, body in inner:
            name, value = _matrix(kind, body, MAX_DEPTH)
            if value is not None:
                found[name] = value
    return found


def _unpacked(data: bytes, limit: int) -> bytes:
    unpacker = zlib.decompressobj()
    try:
        body = unpacker.decompress(data, max(1, limit))
    except zlib.error as error:
        raise ValueError(f"it is damaged: {error}") from error
    if unpacker.unconsumed_tail:
        raise ValueError(f"it unpacks to more than {MAX_BYTES} bytes")
    return body


def _elements(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield type and contents of consecutive elements."""
    position = 0
    while position < len(data):
        if position + 8 > len(data):
            raise ValueError("it is truncated")
        kind, size = _TAG.unpack_from(data, position)
        if kind >> 16:  # a small element: size and up to four bytes within the tag
            kind, size, start, step = kind & 0xFFFF, kind >> 16, position + 4, 8
        else:
            # Packed elements are not padded to eight bytes.
            start, step = position + 8, 8 + (size if kind == PACKED else -(-size // 8) * 8)
        if start + size > len(data) or (start == position + 4 and size > 4):
            raise ValueError("it is truncated")
        yield kind, data[start : start + size]
        position += step


def _matrix(kind: int, body: bytes, depth: int) -> tuple[str, Value | None]:
    """Return name and value of a matrix; None if it holds neither numbers nor a structure."""
    if kind != MATRIX:
        raise ValueError(f"it holds data of type {kind} where a matrix should be")
    if not body:
        return "", None
    parts = list(_elements(body))
    if len(parts) < 3:
        raise ValueError("a matrix is damaged")
    flags, dimensions, name, *rest = parts
    if not depth or len(flags[1]) != 8 or len(dimensions[1]) % 4 or len(dimensions[1]) > 128:
        raise ValueError("a matrix is damaged")
    matrix_class, bits = flags[1][0], flags[1][1]
    shape = struct.unpack(f"<{len(dimensions[1]) // 4}i", dimensions[1])
    text = name[1].decode("latin-1")
    if matrix_class == STRUCT and math.prod(shape) == 1 and min(shape) == 1:
        return text, _structure(rest, depth)
    if matrix_class in CLASSES and not bits & COMPLEX and len(rest) == 1:
        return text, _numbers(shape, CLASSES[matrix_class], *rest[0])
    return text, None


def _numbers(shape: tuple[int, ...], wanted: str, kind: int, data: bytes) -> npt.NDArray[Any]:
    if kind not in STORED:
        raise ValueError(f"a matrix has numbers of type {kind}")
    stored = np.dtype(STORED[kind]).newbyteorder("<")
    if min(shape, default=-1) < 0 or math.prod(shape) * stored.itemsize != len(data):
        raise ValueError(f"a matrix of {shape[:4]} cannot be in {len(data)} bytes")
    return np.frombuffer(data, stored).reshape(shape, order="F").astype(wanted)


def _structure(rest: Sequence[tuple[int, bytes]], depth: int) -> dict[str, Value]:
    """Read a structure of one element: length of the names, the names, and a matrix for each."""
    if len(rest) < 2 or len(rest[0][1]) != 4:
        raise ValueError("a structure is damaged")
    (length,) = struct.unpack("<i", rest[0][1])
    if not 1 < length <= 64 or len(rest[1][1]) != length * (len(rest) - 2):
        raise ValueError("a structure has other names than values")
    found: dict[str, Value] = {}
    for number, (kind, body) in enumerate(rest[2:]):
        text = rest[1][1][number * length : (number + 1) * length]
        _, value = _matrix(kind, body, depth - 1)
        if value is not None:
            found[text.partition(b"\0")[0].decode("latin-1")] = value
    return found
