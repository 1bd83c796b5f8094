"""Arrays of numbers from untrusted NPZ and NPY files: no objects, no more bytes than declared."""

import math
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from common.io.files import read_bytes

MAX_BYTES = 256 * 2**20  # maximum size of one array
MAX_HEADER_BYTES = 4096  # maximum size of the header with type and shape
NUMBERS = "biuf"  # kinds of numpy types: booleans, integers, floats
# Other compressions may unpack more bytes than declared
PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def read_arrays(
    path: Path, needed: Sequence[str], optional: Sequence[str] = ()
) -> Mapping[str, npt.NDArray[Any]]:
    """Read needed and optional arrays by name.

    OSError if the file cannot be read; ValueError if it is not an NPZ file or lacks an array, or if
    an array is damaged, too large or not numeric.
    """
    try:
        with zipfile.ZipFile(path) as file:
            names = set(file.namelist())
            lacking = [name for name in needed if f"{name}.npy" not in names]
            if lacking:
                raise ValueError(f"it has no array {lacking[0]}")
            wanted = [*needed, *(name for name in optional if f"{name}.npy" in names)]
            return {name: _array(file, name, path.stat().st_size) for name in wanted}
    except (zipfile.BadZipFile, zipfile.LargeZipFile, NotImplementedError, RuntimeError) as error:
        raise ValueError(f"it is no NPZ file: {error}") from error  # RuntimeError: encrypted
    except (EOFError, zlib.error) as error:
        raise ValueError(f"it is damaged: {error}") from error


def read_array(path: Path) -> npt.NDArray[Any]:
    """Read an NPY file; OSError if it is unreadable, ValueError if it is no such file."""
    return _parse(path.name, read_bytes(path, MAX_BYTES))


def _array(file: zipfile.ZipFile, name: str, end: int) -> npt.NDArray[Any]:
    member = file.getinfo(f"{name}.npy")
    if member.compress_type not in PACKINGS:
        raise ValueError(f"array {name} is packed in a way that numpy does not write")
    if member.file_size > MAX_BYTES:
        raise ValueError(f"array {name} is larger than {MAX_BYTES} bytes")
    # Reading allocates the declared compressed size at once.
    if member.compress_size > end:
        raise ValueError(f"array {name} is truncated")
    return _parse(name, file.read(member))  # at most file_size


def _parse(name: str, data: bytes) -> npt.NDArray[Any]:
    try:
        shape, column_major, kind, start = _header(data)
    except (ValueError, TypeError, SyntaxError, RecursionError, MemoryError) as error:
        raise ValueError(f"array {name} is damaged: {error}") from error
    if kind.kind not in NUMBERS or kind.fields or kind.shape:
        raise ValueError(f"array {name}: expected numbers, got {kind!r:.80}")
    count = math.prod(shape)
    if min(shape, default=0) < 0 or count * kind.itemsize != len(data) - start:
        raise ValueError(f"array {name}: {len(data) - start} bytes do not fill {shape} of {kind}")
    flat = np.frombuffer(data, kind, count, start)
    return flat.reshape(shape, order="F" if column_major else "C")


def _header(data: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any], int]:
    text = BytesIO(data)
    version = np.lib.format.read_magic(text)
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    if version not in readers:
        raise ValueError(f"version {version[0]}.{version[1]} is not supported")
    shape, column_major, kind = readers[version](text, MAX_HEADER_BYTES)
    return shape, column_major, kind, text.tell()
