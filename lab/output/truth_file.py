"""The truth of all frames in one file, put together from those of some frames each."""

import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from people4d.errors import SourceError

CONSTANT = ("K",)  # arrays that are the same in all parts; the others have a row for each frame


def join_frames(path: Path, parts: Sequence[Path]) -> None:
    """Put files of `frame_truth.save_frames` together; one is in memory at a time.

    Args:
        path: The file; its bytes depend on nothing but the arrays.
        parts: In the order of their frames; at least one.

    Raises:
        SourceError: The file cannot be written.
    """
    with np.load(parts[0]) as first:
        names = list(first)
    try:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in names:
                _join(archive, name, parts[:1] if name in CONSTANT else parts)
    except OSError as error:
        raise SourceError(f"truth {path} cannot be written: {error.strerror}") from error


def _join(archive: zipfile.ZipFile, name: str, parts: Sequence[Path]) -> None:
    shapes, kinds = zip(*(_form(part, name) for part in parts), strict=True)
    header = {
        "descr": np.lib.format.dtype_to_descr(kinds[0]),
        "fortran_order": False,
        "shape": (sum(shape[0] for shape in shapes), *shapes[0][1:]),
    }
    # The default date of an entry is the time of writing.
    entry = zipfile.ZipInfo(f"{name}.npy")
    entry.compress_type = zipfile.ZIP_DEFLATED
    with archive.open(entry, "w", force_zip64=True) as file:
        np.lib.format.write_array_header_1_0(file, header)
        for part in parts:
            with np.load(part) as arrays:
                file.write(np.ascontiguousarray(arrays[name]).tobytes())


def _form(part: Path, name: str) -> tuple[tuple[int, ...], np.dtype[np.generic]]:
    with np.load(part) as arrays:
        array = arrays[name]
    return array.shape, array.dtype
