"""Pairs of colour and depth files in a folder, and their times."""

import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from common.geometry.transforms import wrap
from common.io.files import inside, read_text
from people4d.errors import SourceError
from people4d.messages import F64, Odometry
from services.camera.folder.pairing import Pairing

IMAGES = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".ppm", ".pgm"}
DEPTHS = IMAGES | {".mat", ".npy"}
COLOUR_FOLDERS = ("rgb", "color", "colour", "image", "images")
LAYOUTS = (
    *((f"{folder}/*", "depth/*") for folder in COLOUR_FOLDERS),
    *(("*color*", "*depth*"), ("*rgb*", "*depth*"), ("*", "*.mat")),
)
# Unsupported formats of images, depth and videos
UNREAD = {".exr", ".pfm", ".raw", ".bin", ".depth", ".npz", ".webp", ".heic"}
UNREAD |= {".mp4", ".mov", ".avi", ".mkv", ".svo", ".svo2", ".oni"}
# Times as names: seconds with a fraction, or whole milli-, micro- or nanoseconds since 1970.
SECONDS = re.compile(r"(?:.*\D)?([1-9]\d{8,9})[._](\d{6}|\d{9})|(\d+)\.(\d+)")
SINCE_1970 = re.compile(r"(?:.*\D)?(1\d{12}|1\d{15}|1\d{18})")
LISTS = ("rgb.txt", "depth.txt")
MAX_LIST_BYTES = 64 * 2**20  # [bytes] maximum size of a list: half a million frames
MAX_TIME_S = 2**33  # [s] maximum time, in the year 2242: nanoseconds fit 64 bits


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


def named(
    folder: Path, patterns: tuple[str, str], stamps: F64 | float, slop_s: float
) -> FolderLayout:
    """Pair files by times in their names, or else by the last number in their names.

    SourceError if no pair was found, two files have the same number, or there are fewer times than
    frames.

    Args:
        folder: Folder with the files.
        patterns: Patterns of colour and depth, relative to the folder; empty: the usual ones.
        stamps: Times of the frames [s] in the order of their numbers, or the frame rate [Hz].
        slop_s: Maximum time difference of a pair by times [s].
    """
    tried = [patterns] if any(patterns) else LAYOUTS
    for colour, depth in tried:
        colours, depths = _files(folder, colour, IMAGES), _files(folder, depth, DEPTHS)
        times_ns = {path: _time_ns(path.stem) for path in (*colours, *depths)}
        if colours and depths and None not in times_ns.values():
            entries = [
                (time_ns, stream, path)
                for stream, paths in (("colour", colours), ("depth", depths))
                for path in paths
                if (time_ns := times_ns[path]) is not None
            ]
            return _retimed(_near(folder, entries, slop_s, (colour, depth)), stamps)
        layout = _numbered(colours, depths, stamps)
        if layout.pairs:
            return layout
    raise SourceError(
        f"folder {folder} has no numbered pairs of colour and depth "
        f"({' or '.join(f'{c} with {d}' for c, d in tried)})",
        _unread(folder, tried)
        or "Set options.colour and options.depth to patterns such as 'rgb/*.jpg'.",
    )


def _numbered(colours: Sequence[Path], depths: Sequence[Path], stamps: F64 | float) -> FolderLayout:
    colour_by_number, depth_by_number = _by_number(colours), _by_number(depths)
    numbers = sorted(colour_by_number.keys() & depth_by_number.keys())
    for paths in [colour_by_number, depth_by_number] if numbers else []:
        twice = next((same for same in paths.values() if len(same) > 1), None)
        if twice:
            raise SourceError(
                f"{twice[0]} and {twice[1].name} have the same number",
                "Set options.colour and options.depth to patterns of one file for each frame.",
            )
    times_s = _times(stamps, len(numbers))
    pairs = [
        ImagePair(round(float(t) * 1e9), colour_by_number[n][0], depth_by_number[n][0])
        for t, n in zip(times_s, numbers, strict=True)
    ]
    return FolderLayout(pairs, len(colours) + len(depths) - 2 * len(pairs))


def _retimed(layout: FolderLayout, stamps: F64 | float) -> FolderLayout:
    """Return pairs with the times of the track file, if there is one."""
    if isinstance(stamps, (int, float)):
        return layout
    times_s = _times(stamps, len(layout.pairs))
    pairs = [
        replace(pair, stamp_ns=round(float(t) * 1e9))
        for t, pair in zip(times_s, layout.pairs, strict=True)
    ]
    return replace(layout, pairs=pairs)


def _unread(folder: Path, patterns: Iterable[tuple[str, str]]) -> str:
    """Return a remedy for files of unsupported formats, empty if there are none."""
    for pattern in dict.fromkeys(itertools.chain(*patterns)):
        for path in sorted(folder.glob(pattern)):
            if path.suffix.lower() in UNREAD:
                return (
                    f"{path.relative_to(folder)} is of a kind that is not read: write colour as "
                    "JPEG or PNG, depth as PNG of 16 bits or .npy of uint16, in millimetres."
                )
    return ""


def listed(folder: Path, slop_s: float) -> FolderLayout:
    """Pair files by times in TUM's rgb.txt and depth.txt; SourceError without a pair."""
    entries = [
        (stamp_ns, stream, path)
        for stream, file in zip(("colour", "depth"), LISTS, strict=True)
        for stamp_ns, path in _read_list(folder, file)
    ]
    return _near(folder, entries, slop_s)


def _near(
    folder: Path,
    entries: Iterable[tuple[int, str, Path]],
    slop_s: float,
    names: tuple[str, str] = LISTS,
) -> FolderLayout:
    """Pair each image with the nearest image in time of the other stream."""
    pairing = Pairing[tuple[int, Path]](round(slop_s * 1e9))
    found: list[tuple[tuple[int, Path], tuple[int, Path]]] = []
    for stamp_ns, stream, path in sorted(entries):
        image = (stamp_ns, path)
        found += pairing.add_image("colour" if stream == "colour" else "depth", stamp_ns, image)
    found += pairing.flush()
    if not found:
        raise SourceError(
            f"folder {folder}: no image of {names[0]} is within {slop_s} s of one of {names[1]}",
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


def _files(folder: Path, pattern: str, suffixes: set[str]) -> list[Path]:
    parts = Path(pattern).parts
    if not parts or Path(pattern).is_absolute() or ".." in parts or "\0" in pattern:
        raise SourceError(f"pattern: expected one below the folder, got {pattern!r}")
    return [
        _inside(folder, str(path.relative_to(folder)))
        for path in sorted(folder.glob(pattern))
        if path.suffix.lower() in suffixes and path.is_file()
    ]


def _by_number(files: Iterable[Path]) -> dict[int, list[Path]]:
    by_number: dict[int, list[Path]] = {}
    for path in files:
        numbers = re.findall(r"\d+", path.stem)
        if numbers:
            by_number.setdefault(int(numbers[-1]), []).append(path)
    return by_number


def _time_ns(stem: str) -> int | None:
    """Return the time in the name of a file, None if there is none."""
    if match := SECONDS.fullmatch(stem):
        seconds, fraction = (match[1], match[2]) if match[1] else (match[3], match[4])
        time_ns = int(seconds) * 10**9 + int(f"{fraction[:9]:0<9}")
    elif match := SINCE_1970.fullmatch(stem):
        time_ns = int(match[1]) * 10 ** (19 - len(match[1]))
    else:
        return None
    return time_ns if time_ns <= MAX_TIME_S * 10**9 else None


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
            # Split to keep nanoseconds: a float has only 16 digits.
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
