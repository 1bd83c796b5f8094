"""Arrays from files that are not trusted."""

import io
import pickle
import struct
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.io.npz import MAX_BYTES, read_arrays


def header(shape: tuple[int, ...], kind: str = "<f8", version: int = 1) -> bytes:
    text = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    return b"\x93NUMPY" + bytes([version, 0]) + struct.pack("<H", len(text) + 1) + text + b"\n"


def npz(path: Path, data: bytes, packing: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", packing) as file:
        file.writestr("a.npy", data)
    return path


def test_what_numpy_writes_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    arrays: dict[str, Any] = {
        "plain": np.arange(6.0).reshape(2, 3),
        "columns": np.asfortranarray(np.arange(6, dtype=">i2").reshape(2, 3)),
        "empty": np.zeros((0, 3), np.float32),
        "scalar": np.array(True),
    }
    for save in (np.savez, np.savez_compressed):
        save(path, **arrays)
        got = read_arrays(path, ["plain", "columns"], ["empty", "scalar", "none"])
        assert got.keys() == arrays.keys()
        for name, array in arrays.items():
            np.testing.assert_array_equal(got[name], array)
            assert got[name].dtype == array.dtype


class Evil:
    def __reduce__(self) -> Any:
        return open, ("/nonexistent/made-by-a-pickle", "w")


def pickled() -> bytes:
    text = io.BytesIO()
    np.save(text, np.array([0], object))
    return text.getvalue()[: text.getvalue().index(b"\n") + 1] + pickle.dumps([Evil()])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (pickled(), "expected numbers, got dtype"),
        (pickle.dumps(Evil()), "is damaged"),
        (header((3,)) + bytes(16), "16 bytes do not fill"),
        (header((10**12,)) + bytes(16), "16 bytes do not fill"),
        (header((2**62, 4)) + bytes(16), "16 bytes do not fill"),
        (header((-1,)) + bytes(8), "do not fill"),
        (header((2,), "<U100000"), "expected numbers"),
        (header((2,), "<M8[s]") + bytes(16), "expected numbers"),
        (header((2,), version=3) + bytes(16), "version 3.0"),
        (b"\x93NUMPY\x01\x00\xff\xff(" + b"(" * 65534, "is damaged"),
        (b"", "is damaged"),
    ],
)
def test_what_is_no_array_of_numbers_is_refused(data: bytes, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        read_arrays(npz(tmp_path / "a.npz", data), ["a"])


@pytest.mark.slow
def test_an_array_that_unpacks_to_a_gigabyte_is_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file, file.open("a.npy", "w") as part:
        for _ in range(MAX_BYTES // 2**20 + 1):
            part.write(bytes(2**20))
    assert path.stat().st_size < 2**20
    tracemalloc.start()
    with pytest.raises(ValueError, match="larger than"):
        read_arrays(path, ["a"])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**20


@pytest.mark.parametrize("packing", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_packings_without_a_limit_are_refused(packing: int, tmp_path: Path) -> None:
    # bz2 turns four kilobytes into gigabytes at once, whatever size is declared.
    with pytest.raises(ValueError, match="packed in a way"):
        read_arrays(npz(tmp_path / "a.npz", bytes(10**6), packing), ["a"])


def test_array_larger_than_its_declared_size_is_refused(tmp_path: Path) -> None:
    path = npz(tmp_path / "a.npz", header((10**6,)) + bytes(8 * 10**6))
    size = struct.pack("<I", len(header((10**6,))) + 8 * 10**6)
    path.write_bytes(path.read_bytes().replace(size, struct.pack("<I", 200)))
    with pytest.raises(ValueError, match=r"CRC|are no"):
        read_arrays(path, ["a"])


@pytest.mark.parametrize("data", [b"", b"PK", b"junk" * 100, b"PK\x05\x06" + bytes(18)])
def test_what_is_no_archive_is_refused(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(data)
    with pytest.raises(ValueError, match=r"no NPZ file|no array"):
        read_arrays(tmp_path / "a.npz", ["a"])


def test_more_packed_bytes_than_there_are_are_not_asked_for(tmp_path: Path) -> None:
    # An array must be read before memory of its declared size is allocated.
    path = npz(tmp_path / "a.npz", header((1,)) + bytes(8), zipfile.ZIP_STORED)
    size = struct.pack("<I", len(header((1,))) + 8)
    data = path.read_bytes()
    at = data.rindex(size + size)  # packed and not, in the directory
    path.write_bytes(data[:at] + struct.pack("<I", 2**32 - 2) + data[at + 4 :])
    with pytest.raises(ValueError, match="array a is truncated"):
        read_arrays(path, ["a"])
