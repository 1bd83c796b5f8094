"""Arrays of MATLAB files that are not trusted, looked through before scipy makes arrays of them.

scipy allocates what a file says before it reads what there is. So every matrix is visited here
first: what it says must fit into the bytes that it has.
"""

import math
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import scipy.io

from common.files import read_bytes

MAX_BYTES = 64 * 2**20  # of the file, and of what is packed in it
MAX_DEPTH = 8  # of structures in structures
HEADER_BYTES = 128
MATRIX, PACKED = 14, 15  # types of data elements
CELL, STRUCT, CHARACTERS, NUMBERS = 1, 2, 4, range(6, 16)  # classes of matrices

_TAG = struct.Struct("<II")


def read_mat(path: Path, names: Sequence[str] | None = None) -> Mapping[str, Any]:
    """Read arrays of numbers, and structures of them, from a MATLAB file (version 5 to 7).

    Args:
        path: The file.
        names: Arrays wanted; None for all.

    Raises:
        OSError: The file cannot be read, or is too large.
        ValueError: It is no such file, is damaged, or holds what is neither number nor structure.
    """
    data = read_bytes(path, MAX_BYTES)
    if len(data) < HEADER_BYTES or data[124:128] != b"\x00\x01IM":
        raise ValueError("it is no MATLAB file of version 5 to 7")
    budget = MAX_BYTES
    for kind, body in _elements(data[HEADER_BYTES:]):
        if kind == PACKED:
            body = _unpacked(body, budget)
            budget -= len(body)
            for inner, matrix in _elements(body):
                _check(inner, matrix, MAX_DEPTH)
        else:
            _check(kind, body, MAX_DEPTH)
    try:
        file: Any = BytesIO(data)  # which scipy takes, whatever its types say
        found: dict[str, Any] = scipy.io.loadmat(
            file, variable_names=None if names is None else list(names)
        )
    except Exception as error:  # scipy raises many kinds on damaged files
        raise ValueError(f"it is damaged: {error}") from error
    return found


def _unpacked(data: bytes, limit: int) -> bytes:
    unpacker = zlib.decompressobj()
    try:
        body = unpacker.decompress(data, limit)
    except zlib.error as error:
        raise ValueError(f"it is damaged: {error}") from error
    if unpacker.unconsumed_tail:
        raise ValueError(f"it unpacks to more than {MAX_BYTES} bytes")
    return body


def _elements(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield type and contents of the elements that lie one after the other."""
    position = 0
    while position < len(data):
        if position + 8 > len(data):
            raise ValueError("it is cut")
        kind, size = _TAG.unpack_from(data, position)
        if kind >> 16:  # a small element: size and up to four bytes within the tag
            kind, size, start, step = kind & 0xFFFF, kind >> 16, position + 4, 8
        else:
            # Packed elements are not padded to eight bytes.
            start, step = position + 8, 8 + (size if kind == PACKED else -(-size // 8) * 8)
        if start + size > len(data) or (step == 8 and size > 4):
            raise ValueError("it is cut")
        yield kind, data[start : start + size]
        position += step


def _check(kind: int, body: bytes, depth: int) -> None:
    """Check that a matrix has the bytes for all that it says it has."""
    if kind != MATRIX:
        raise ValueError(f"it holds data of type {kind} where a matrix should be")
    if not body:
        return
    parts = list(_elements(body))
    if len(parts) < 3 or len(parts[0][1]) != 8 or len(parts[1][1]) % 4 or not depth:
        raise ValueError("a matrix is damaged")
    told = parts[0][1][0]
    shape = struct.unpack(f"<{len(parts[1][1]) // 4}i", parts[1][1])
    if len(shape) > 32 or min(shape, default=-1) < 0 or math.prod(shape) > len(body):
        raise ValueError(f"a matrix of {shape[:4]} is told in {len(body)} bytes")
    inner = [(kind, part) for kind, part in parts[3:] if kind == MATRIX]
    if told not in (CELL, STRUCT, CHARACTERS, *NUMBERS) or (inner and told not in (CELL, STRUCT)):
        raise ValueError(f"a matrix is of class {told}, which holds no numbers")
    for kind, part in inner:
        _check(kind, part, depth - 1)
