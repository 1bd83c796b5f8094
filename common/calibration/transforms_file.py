"""File with the poses of cameras, which a calibration writes and each camera reads."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import msgspec
import numpy as np

from common.geometry.frame_graph import find_loop
from common.io.files import read_toml, replace_file
from people4d.errors import CalibrationError, SourceError
from people4d.messages import F64, StaticTransform

if TYPE_CHECKING:  # only solving needs scipy
    from common.calibration.solve import CalibrationResult

MAP = "map"
RIGID_M = 1e-4  # tolerance of a rotation matrix
Row: TypeAlias = tuple[float, float, float, float]


class CameraEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The pose of one camera."""

    frame_id: str  # optical frame
    matrix: tuple[Row, Row, Row, Row]  # [m] map_from_optical
    sigma_m: float = 0.0  # [m] standard deviation of the position relative to the reference
    sigma_deg: float = 0.0  # [deg] standard deviation of the rotation
    clock_offset_ms: float = 0.0  # [ms] camera clock minus reference clock
    pairs: dict[str, float] = {}  # [s] time with a common person, by other camera


class TransformsFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All entries."""

    reference: str  # reference camera of the poses
    cameras: dict[str, CameraEntry]


def write_transforms(path: Path, calibration: "CalibrationResult") -> None:
    """Write the poses of a calibration in one step; SourceError if the file cannot be written."""
    lines = [
        "# Poses of cameras in the map, by people4d calibrate; use: people4d up --transforms FILE",
        f'reference = "{calibration.reference}"',
    ]
    for name, matrix in sorted(calibration.map_from_camera.items()):
        pose = calibration.poses[name]
        seconds = {
            (b if a == name else a): s
            for (a, b), s in calibration.adjustment.pair_seconds.items()
            if name in (a, b)
        }
        rows = ",\n  ".join(str([round(float(v), 9) for v in row]) for row in matrix)
        pairs = ", ".join(f'"{other}" = {s:.1f}' for other, s in sorted(seconds.items()))
        lines += [
            f'\n[cameras."{name}"]',
            f'frame_id = "{calibration.frames[name]}"',
            f"matrix = [\n  {rows},\n]",
            f"sigma_m = {pose.sigma_m:.5f}",
            f"sigma_deg = {np.degrees(pose.sigma_rad):.4f}",
            f"clock_offset_ms = {1e3 * pose.offset_s:.3f}",
            f"pairs = {{ {pairs} }}",
        ]
    try:
        replace_file(path, ("\n".join(lines) + "\n").encode())
    except OSError as error:
        raise SourceError(f"{path} cannot be written: {error.strerror}") from error


def read_transforms(path: Path) -> TransformsFile:
    """Read a file; SourceError if the file cannot be read, or a matrix is not a rigid transform."""
    try:
        found = msgspec.convert(read_toml(path), TransformsFile)
    except OSError as error:
        raise SourceError(f"transforms {path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise SourceError(f"transforms {path}: {error}") from error
    for name, entry in found.cameras.items():
        matrix = np.array(entry.matrix)
        turn = matrix[:3, :3]
        wrong = np.abs(turn @ turn.T - np.eye(3)).max() if np.isfinite(matrix).all() else np.inf
        if wrong > RIGID_M or np.linalg.det(turn) < 0 or list(entry.matrix[3]) != [0, 0, 0, 1]:
            raise SourceError(f"transforms {path}: the matrix of {name} is not a rigid transform")
    return found


def read_pose(path: Path, camera: str) -> F64:
    """Return map_from_optical (4x4); SourceError if the file is unreadable or lacks the camera."""
    found = read_transforms(path)
    if camera not in found.cameras:
        names = ", ".join(sorted(found.cameras)) or "none"
        raise SourceError(f"transforms {path} has no camera {camera}", f"It has {names}.")
    return np.array(found.cameras[camera].matrix)


def check_tree(transforms: Sequence[StaticTransform], frames: Mapping[str, str]) -> None:
    """Check that the map may become the parent of the cameras' optical frames.

    CalibrationError if a camera is on a base, or the transforms form a loop.

    Args:
        transforms: Transforms that are published now.
        frames: Optical frame by camera.
    """
    parents = {t.child: t.parent for t in transforms}
    if loop := find_loop(parents):
        raise CalibrationError(
            f"transforms form a loop: {' <- '.join(loop)}", "Remove one of them."
        )
    for camera, frame in frames.items():
        if parents.get(frame, MAP) != MAP:
            raise CalibrationError(
                f"{camera} is mounted on {parents[frame]}, which may move",
                "Leave it out with --cameras; a pose in the map would be a second parent.",
            )
