"""MATLAB files that are not trusted."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from services.camera.folder.mat_file import read_mat

HEADER = b"MATLAB 5.0".ljust(124) + b"\0\1IM"


def element(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)


def matrix(matrix_class: int, shape: tuple[int, ...], *rest: bytes) -> bytes:
    parts = [
        element(6, struct.pack("<II", matrix_class, 0)),
        element(5, struct.pack(f"<{len(shape)}i", *shape)),
        element(1, b"a"),
        *rest,
    ]
    return element(14, b"".join(parts))


def packed(body: bytes) -> bytes:
    data = zlib.compress(body)
    return struct.pack("<II", 15, len(data)) + data


def test_what_scipy_writes_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    arrays: dict[str, Any] = {
        "depth_array": np.arange(12, dtype=np.uint16).reshape(3, 4),
        "camera": {"K": np.eye(3), "lens": {"k1": 0.5, "name": "left"}},
        "two": np.array([[1.0, 2.0]]),
    }
    for compress in (False, True):
        scipy.io.savemat(path, arrays, do_compression=compress)
        got: Any = read_mat(path)
        assert np.asarray(got["depth_array"]).tolist() == arrays["depth_array"].tolist()
        assert got["camera"]["K"].tolist() == np.eye(3).tolist()
        assert got["camera"]["lens"].keys() == {"k1"}  # text is passed over
        assert got["two"].tolist() == [[1.0, 2.0]]


@pytest.mark.parametrize("kind", ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"])
def test_numbers_are_those_that_scipy_reads(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    array = np.random.default_rng(0).integers(0, 100, (3, 4, 2)).astype(kind)
    scipy.io.savemat(path, {"a": array})
    got = read_mat(path)["a"]
    assert isinstance(got, np.ndarray)
    assert got.dtype == np.dtype(kind)
    np.testing.assert_array_equal(got, scipy.io.loadmat(path)["a"])


NUMBER = matrix(6, (1, 1), element(9, bytes(8)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "message"),
    [
        (matrix(6, (100_000, 20_000), element(9, bytes(8))), "cannot be in 8 bytes"),
        (matrix(6, (-1, 4), element(9, b"")), "cannot be in"),
        (matrix(6, (1, 1), element(99, bytes(8))), "numbers of type 99"),
        (matrix(2, (1, 1), element(5, b"\1\0\0\0"), element(1, b"")), "other names than values"),
        (matrix(2, (1, 1), element(5, b"\2\0\0\0"), element(1, b"a\0b\0"), NUMBER), "other names"),
        (element(9, bytes(8)), "where a matrix should be"),
        (matrix(6, (1, 1))[:-4], "truncated"),
        (struct.pack("<II", 14, 2**32 - 1), "truncated"),
        (packed(bytes(80 * 2**20)), "unpacks to more"),
        (struct.pack("<II", 15, 9) + b"not packed", "cut|damaged"),
    ],
)
def test_matrix_larger_than_its_data_is_refused(body: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(HEADER + body)
    with pytest.raises(ValueError, match=message):
        read_mat(path)


@pytest.mark.parametrize(
    "body",
    [
        matrix(1, (100_000, 20_000)),  # cells: 16 GB of references
        matrix(2, (2**31 - 1, 2**31 - 1), element(5, b"\1\0\0\0"), element(1, b"")),
        matrix(3, (1, 1), NUMBER),
        matrix(17, (1, 1)),
    ],
)
def test_what_holds_no_numbers_is_excluded(body: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(HEADER + body + NUMBER)
    assert read_mat(path) == {"a": np.zeros((1, 1))}


def test_structures_in_structures_end(tmp_path: Path) -> None:
    body = matrix(6, (1, 1), element(9, bytes(8)))
    for _ in range(200):
        body = matrix(2, (1, 1), element(5, b"\2\0\0\0"), element(1, b"a\0"), body)
    (tmp_path / "a.mat").write_bytes(HEADER + body)
    with pytest.raises(ValueError, match="a matrix is damaged"):
        read_mat(tmp_path / "a.mat")


def test_another_version_is_refused(tmp_path: Path) -> None:
    for data in (b"", b"MATLAB 7.3".ljust(124) + b"\0\2IM", bytes(200)):
        (tmp_path / "a.mat").write_bytes(data)
        with pytest.raises(ValueError, match="no MATLAB file of version 5 to 7"):
            read_mat(tmp_path / "a.mat")
