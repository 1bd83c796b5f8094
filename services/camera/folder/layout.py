"""Pairs of colour and depth files in a folder, and their times."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.geometry.transforms import wrap
from common.io.files import inside, read_text
from people4d.errors import SourceError
from people4d.messages import F64, Odometry
from services.camera.folder.pairing import Pairing

IMAGES = {".jpg", ".jpeg", ".png", ".bmp", ".ppm", ".pgm"}
LAYOUTS = (("rgb/*", "depth/*"), ("color/*", "depth/*"), ("colour/*", "depth/*"), ("*", "*.mat"))
LISTS = ("rgb.txt", "depth.txt")
MAX_LIST_BYTES = 64 * 2**20  # of a list: half a million frames
MAX_TIME_S = 2**33  # [s] the year 2242; beyond it nanoseconds do not fit 64 bits


@dataclass(frozen=True)
class ImagePair:
    """The two files of one frame."""

    stamp_ns: int
    colour: Path
    depth: Path


@dataclass(frozen=True)
class FolderLayout:
    """Image pairs of a folder, and the number of files without a partner."""

    pairs: Sequence[ImagePair]
    unpaired: int


def numbered(folder: Path, patterns: tuple[str, str], stamps: F64 | float) -> FolderLayout:
    """Pair files by the last number in their names.

    Args:
        folder: The folder.
        patterns: Of colour and of depth, relative to the folder; empty: the usual ones.
        stamps: Times of the frames in seconds, in the order of their numbers; or frames a second.

    Raises:
        SourceError: No pair was found, or there are fewer times than frames.
    """
    for colour, depth in [patterns] if any(patterns) else LAYOUTS:
        colours = _by_number(_files(folder, colour, IMAGES))
        depths = _by_number(_files(folder, depth, IMAGES | {".mat"}))
        numbers = sorted(colours.keys() & depths.keys())
        if numbers:
            times_s = _times(stamps, len(numbers))
            pairs = [
                ImagePair(round(float(t) * 1e9), colours[n], depths[n])
                for t, n in zip(times_s, numbers, strict=True)
            ]
            return FolderLayout(pairs, len(colours) + len(depths) - 2 * len(numbers))
    tried = [patterns] if any(patterns) else LAYOUTS
    raise SourceError(
        f"folder {folder} has no numbered pairs of colour and depth "
        f"({' or '.join(f'{c} with {d}' for c, d in tried)})",
        "Set options.colour and options.depth to patterns such as 'rgb/*.jpg'.",
    )


def listed(folder: Path, slop_s: float) -> FolderLayout:
    """Pair files that TUM's rgb.txt and depth.txt list with times; SourceError if none pair."""
    pairing = Pairing[tuple[int, Path]](round(slop_s * 1e9))
    entries = [
        (stamp_ns, stream, path)
        for stream, file in zip(("colour", "depth"), LISTS, strict=True)
        for stamp_ns, path in _read_list(folder, file)
    ]
    found: list[tuple[tuple[int, Path], tuple[int, Path]]] = []
    for stamp_ns, stream, path in sorted(entries):
        image = (stamp_ns, path)
        found += pairing.add("colour" if stream == "colour" else "depth", stamp_ns, image)
    found += pairing.flush()
    if not found:
        raise SourceError(
            f"folder {folder}: no image of {LISTS[0]} is within {slop_s} s of one of {LISTS[1]}",
            "Set options.sync_slop_s.",
        )
    pairs = [ImagePair(stamp_ns, colour, depth) for (stamp_ns, colour), (_, depth) in found]
    return FolderLayout(pairs, pairing.unpaired)


def wheel_odometry(times_s: F64, poses: F64) -> list[Odometry]:
    """Return odometry from N times and Nx3 poses (x, y in metres, yaw in radians)."""
    times_s = _checked(times_s)
    poses = np.asarray(poses, np.float64)
    if poses.shape != (len(times_s), 3) or not np.all(np.isfinite(poses)):
        raise SourceError(f"odom: expected {len(times_s)}x3 finite numbers, got {poses.shape}")
    return [
        Odometry(
            stamp_ns=round(float(t) * 1e9),
            sequence=index,
            frame_id="odom",
            child_frame_id="base_link",
            x_m=float(x),
            y_m=float(y),
            theta_rad=wrap(float(theta)),
        )
        for index, (t, (x, y, theta)) in enumerate(zip(times_s, poses, strict=True))
    ]


def _times(stamps: F64 | float, count: int) -> F64:
    if isinstance(stamps, (int, float)):
        return np.arange(count) / stamps
    if len(_checked(stamps)) < count:
        raise SourceError(f"times: expected {count}, got {len(stamps)}")
    return np.asarray(stamps[:count], np.float64)


def _checked(times_s: F64) -> F64:
    if times_s.ndim != 1 or not np.all(np.abs(times_s) <= MAX_TIME_S):
        raise SourceError(f"times: expected seconds up to {MAX_TIME_S}, got others")
    return times_s


def _files(folder: Path, pattern: str, suffixes: set[str]) -> Iterator[Path]:
    parts = Path(pattern).parts
    if not parts or Path(pattern).is_absolute() or ".." in parts or "\0" in pattern:
        raise SourceError(f"pattern: expected one below the folder, got {pattern!r}")
    for path in sorted(folder.glob(pattern)):
        if path.suffix.lower() in suffixes and path.is_file():
            yield _inside(folder, str(path.relative_to(folder)))


def _by_number(files: Iterable[Path]) -> dict[int, Path]:
    numbers = ((re.findall(r"\d+", path.stem), path) for path in files)
    return {int(found[-1]): path for found, path in numbers if found}


def _inside(folder: Path, name: str) -> Path:
    try:
        return inside(folder, name)
    except ValueError as error:
        raise SourceError(
            f"folder {folder}: {error}", "Copy the file, or play the folder that it is in."
        ) from error


def _read_list(folder: Path, file: str) -> list[tuple[int, Path]]:
    """Read lines of a time in seconds and a file name; '#' begins a comment."""
    path = folder / file
    entries = []
    try:
        lines = read_text(path, MAX_LIST_BYTES).splitlines()
    except (OSError, ValueError) as error:
        raise SourceError(f"list {path} cannot be read: {error}") from error
    for number, line in enumerate(lines, 1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        try:
            seconds, name = words[:2]
            # Split, so that nanoseconds survive: a float holds only 16 digits.
            integer, _, fraction = seconds.partition(".")
            stamp_ns = int(integer) * 10**9 + int(f"{fraction[:9]:0<9}")
            if abs(stamp_ns) > MAX_TIME_S * 10**9:
                raise ValueError("the time is too large")
        except ValueError as error:
            raise SourceError(
                f"list {path}, line {number}: expected a time and a file name, got {line!r:.60}"
            ) from error
        entries.append((stamp_ns, _inside(folder, name)))
    return entries
