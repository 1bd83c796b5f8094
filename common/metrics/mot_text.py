"""Text files of the MOT-Challenge: one box a line, comma-separated.

frame, id, left, top, width, height, confidence, x, y, z: frames count from 1, boxes are in pixels,
id is -1 in detections. In ground truth, confidence 0 marks a box that is not evaluated. The 3D
benchmarks give x, y, z in metres on the ground; -1, -1, -1, NaN or nothing: unknown. If all x are
whole numbers and all y from 0 to 1, they are class and visibility, as in MOT16.
"""

import configparser
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from common.io.files import MAX_TEXT_BYTES, read_text
from common.metrics.record import (
    BOOL,
    I64,
    EvaluationFrame,
    EvaluationSequence,
    GroundTruth,
    Hypotheses,
)
from people4d.errors import DecodeError
from people4d.messages import F64

MAX_BYTES = 256 * 2**20  # maximum size of a text: three hours of thirty people
MAX_NUMBER = 2**53  # maximum number of a frame or an identity
FRAMES_MAX = 10**6  # maximum number of frames of a sequence: nine hours at 30 Hz
RATE_MIN_HZ = 1e-3  # minimum frame rate [Hz]
CLASSES_MAX = 1000  # maximum number of a class
LAYOUT = (
    "frame,id,left,top,width,height,confidence (a frame from 1, a whole id, a positive size) and "
    "up to three more numbers"
)


@dataclass(frozen=True)
class MotRows:
    """The lines of a file, ordered by frame."""

    frames: I64  # N, from 1
    ids: I64  # N, -1 in detections
    boxes_xyxy_px: F64  # [px] Nx4: left, top, right, bottom
    confidences: F64  # N, score of a detection; flag (0 or 1) of ground truth
    positions_m: F64  # [m] Nx3, in the world; NaN if unknown
    classes: I64  # N, since MOT16; 0 if unknown

    def frame_rows(self, frame: int) -> "MotRows":
        """Return the lines of one frame."""
        start, end = np.searchsorted(self.frames, [frame, frame + 1])
        return self._select(slice(start, end))

    def evaluated(self) -> "MotRows":
        """Return the lines with a flag other than 0."""
        return self._select(self.confidences != 0)

    def _select(self, rows: slice | BOOL) -> "MotRows":
        return MotRows(*(getattr(self, field.name)[rows] for field in fields(self)))


@dataclass(frozen=True)
class MotInfo:
    """Content of seqinfo.ini."""

    name: str
    rate_hz: float
    frames: int
    width: int  # [px] width of the images
    height: int  # [px] height of the images


def read_rows(path: Path) -> MotRows:
    """Read the lines of detections, ground truth or tracks, ordered by frame.

    DecodeError if a line is invalid, or an identity occurs twice in a frame.
    """
    rows: list[list[float]] = []
    first_lines: dict[tuple[float, float], int] = {}
    for number, line in enumerate(_text(path).splitlines(), start=1):
        if not line.strip():
            continue
        row = _parse(line, f"{path}, line {number}")
        frame_id = (row[0], row[1])
        if row[1] >= 0 and frame_id in first_lines:
            raise DecodeError(
                f"{path}, line {number}: expected each id once in a frame, got id {row[1]:.0f} "
                f"of frame {row[0]:.0f} again (first in line {first_lines[frame_id]})"
            )
        first_lines[frame_id] = number
        rows.append(row)
    table = np.array(rows).reshape(-1, 11)
    table = table[np.argsort(table[:, 0], kind="stable")]
    corners = np.hstack([table[:, 2:4], table[:, 2:4] + table[:, 4:6]])
    frames, ids = table[:, :2].astype(np.int64).T
    positions, classes = table[:, 7:10], table[:, 10]
    known = np.isfinite(positions).all(axis=1) & ~np.all(positions == -1, axis=1)
    positions = np.where(known[:, None], positions, np.nan)
    if _are_classes(positions):
        classes = np.where(np.isnan(positions[:, 0]), classes, positions[:, 0])
        positions = np.full_like(positions, np.nan)
    return MotRows(frames, ids, corners, table[:, 6], positions, classes.astype(np.int64))


def _are_classes(columns: F64) -> bool:
    """Check that columns 8 and 9 are class and visibility, as in MOT16, not metres."""
    classes, visibility, _ = columns[~np.isnan(columns[:, 0])].T
    integral = (classes >= 1) & (classes <= CLASSES_MAX) & (classes % 1 == 0)
    return bool(np.all(integral & (visibility >= 0) & (visibility <= 1)))


def read_info(path: Path) -> MotInfo:
    """Read seqinfo.ini; DecodeError if [Sequence] or a value is absent or wrong."""
    # Values that refer to other values could grow without limit.
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(_text(path, MAX_TEXT_BYTES))
        section = parser["Sequence"]
        info = MotInfo(
            name=section["name"],
            rate_hz=float(section["frameRate"]),
            frames=int(section["seqLength"]),
            width=int(section["imWidth"]),
            height=int(section["imHeight"]),
        )
        if not RATE_MIN_HZ <= info.rate_hz < math.inf:
            raise ValueError(f"frameRate {info.rate_hz}")
        if not (0 < info.frames <= FRAMES_MAX and info.width > 0 and info.height > 0):
            raise ValueError(f"{info.frames} frames of {info.width} x {info.height} pixels")
    except (configparser.Error, KeyError, ValueError) as error:
        raise DecodeError(
            f"{path}: expected [Sequence] with name, frameRate, seqLength, imWidth and imHeight, "
            f"got {type(error).__name__}: {error!s:.200}"
        ) from error
    return info


def sequence(info: MotInfo, truth: MotRows, tracks: Mapping[int, Hypotheses]) -> EvaluationSequence:
    """Return ground truth and tracks as a sequence without boxes flagged 0, as in TrackEval.

    Tracked people by frame number, from 1; frames without people may be absent.
    """
    evaluated, frames = truth.evaluated(), []
    for number in range(1, info.frames + 1):
        rows = evaluated.frame_rows(number)
        frames.append(
            EvaluationFrame(
                stamp_ns=round((number - 1) * 1e9 / info.rate_hz),
                truth=GroundTruth(ids=tuple(rows.ids.tolist()), boxes_xyxy_px=rows.boxes_xyxy_px),
                hypotheses=tracks.get(number, Hypotheses()),
            )
        )
    return EvaluationSequence(info.name, tuple(frames))


def _text(path: Path, limit: int = MAX_BYTES) -> str:
    try:
        return read_text(path, limit)
    except (OSError, ValueError) as error:
        raise DecodeError(f"{path}: expected a readable text file, got {error}") from error


def _parse(line: str, where: str) -> list[float]:
    """Return ten columns and the class, which is 0 if the line has none."""
    try:
        row = [float(text) for text in line.strip().rstrip(",").split(",")]
    except ValueError:
        row = []
    valid = (
        7 <= len(row) <= 10
        and all(map(math.isfinite, row[:7]))
        and 1 <= row[0] <= MAX_NUMBER
        and abs(row[1]) <= MAX_NUMBER
        and row[0] % 1 == row[1] % 1 == 0
        and min(row[4:6]) > 0
    )
    if not valid:
        raise DecodeError(f"{where}: expected {LAYOUT}, got {line.strip()!r:.80}")
    if len(row) == 10:
        return [*row, 0.0]
    has_class = len(row) > 7 and 1 <= row[7] <= CLASSES_MAX
    return [*row[:7], -1.0, -1.0, -1.0, row[7] if has_class else 0.0]
