"""Calibration of an RGB-D camera, from configuration or from a file."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from common.io.files import parse_toml, parse_yaml, read_text
from common.io.npz import read_arrays
from common.ros2.frame_names import OPTICAL_FRAME, frame_name
from people4d.errors import SourceError
from people4d.messages import F64, CameraInfo, StaticTransform
from services.camera.distortion import is_fisheye, read_distortion
from services.camera.folder.mat_file import read_mat
from services.camera.folder.registration import Registration

DISTORTION_MODELS = {0: "none", 4: "plumb_bob", 5: "plumb_bob", 8: "rational_polynomial"}


class Intrinsics(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A pinhole with distortion, or a fisheye lens."""

    fx: float  # [px] focal length, horizontal
    fy: float  # [px] focal length, vertical
    cx: float  # [px] principal point, horizontal
    cy: float  # [px] principal point, vertical
    distortion: tuple[float, ...] = ()  # k1 k2 p1 p2 k3 k4 k5 k6, with 0, 4, 5 or 8 coefficients
    width: int = 0  # [px] width of its images; 0: any
    height: int = 0  # [px] height of its images; 0: any
    fisheye: bool = False  # True: an equidistant lens, whose 4 coefficients are k1 k2 k3 k4

    def __post_init__(self) -> None:
        """Check the coefficients of a fisheye lens."""
        if self.fisheye and len(self.distortion) != 4:
            raise ValueError(f"fisheye: expected 4 coefficients, got {len(self.distortion)}")


class Calibration(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Calibration of an RGB-D camera; None is unknown."""

    colour: Intrinsics | None = None  # the colour camera
    depth: Intrinsics | None = None  # the depth camera; None if depth is aligned to colour
    rotation: tuple[tuple[float, float, float], ...] | None = None  # 3x3, colour_from_depth
    translation_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] colour_from_depth
    depth_offset_px: tuple[float, float] = (0.0, 0.0)  # [px] u, v, see Registration
    parent: str = "map"  # frame of parent_from_optical
    parent_from_optical: tuple[tuple[float, float, float, float], ...] | None = None  # [m] 4x4


# Variables of a MATLAB calibration: structures of colour and depth, with K and DistCoef
MAT_CAMERAS = ("RGB_cam", "Depth_cam")
MAT_ROTATION, MAT_TRANSLATION = "R_d_to_rgb", "T_d_to_rgb"  # 3x3, [m] 3, colour_from_depth


def read_calibration(path: Path) -> Calibration:
    """Read a calibration file; SourceError if it is incomplete or of another format."""
    readers: dict[str, Callable[[], Calibration]] = {
        ".toml": lambda: _from_table(parse_toml(read_text(path))),
        ".json": lambda: _from_table(json.loads(read_text(path))),
        ".yaml": lambda: _from_camera_info(parse_yaml(read_text(path))),
        ".yml": lambda: _from_camera_info(parse_yaml(read_text(path))),
        ".txt": lambda: _from_matrix(read_text(path)),
        ".csv": lambda: _from_matrix(read_text(path)),
        ".npz": lambda: _from_npz(path),
        ".mat": lambda: _from_mat(path),
    }
    if path.suffix not in readers:
        raise SourceError(f"calibration {path}: expected one of {', '.join(readers)}")
    try:
        return readers[path.suffix]()
    except OSError as error:
        raise SourceError(f"calibration {path} cannot be read: {error.strerror}") from error
    except KeyError as error:
        raise SourceError(f"calibration {path} has no {error}") from error
    except Exception as error:  # parsers raise exceptions without a common base
        raise SourceError(f"calibration {path} is not valid: {str(error)[:400]}") from error


def camera_info(
    intrinsics: Intrinsics, size: tuple[int, int], frame_id: str = OPTICAL_FRAME
) -> CameraInfo:
    """Return a calibration as a message; SourceError if it does not fit images of this size."""
    height, width = size
    if intrinsics.fisheye:
        raise SourceError(
            "depth has a fisheye lens of its own",
            "Align depth to colour in the camera's driver, or give a calibration of a pinhole.",
        )
    if (intrinsics.height or height, intrinsics.width or width) != size:
        raise SourceError(
            f"calibration is for {intrinsics.width}x{intrinsics.height} pixels, "
            f"images have {width}x{height}"
        )
    try:
        return CameraInfo(
            stamp_ns=0,
            sequence=0,
            camera="camera",
            frame_id=frame_name(frame_id),
            width=width,
            height=height,
            fx=intrinsics.fx,
            fy=intrinsics.fy,
            cx=intrinsics.cx,
            cy=intrinsics.cy,
            distortion_model=DISTORTION_MODELS.get(len(intrinsics.distortion), "unknown"),
            distortion=intrinsics.distortion,
        )
    except ValueError as error:
        raise SourceError(f"calibration cannot be used: {error}") from error


def static_transform(parent: str, child: str, matrix: F64) -> StaticTransform:
    """Return parent_from_child as a message; SourceError if it is not a rigid transform."""
    try:
        return StaticTransform(
            stamp_ns=0,
            sequence=0,
            parent=frame_name(parent),
            child=frame_name(child),
            matrix=np.asarray(matrix, np.float64),
        )
    except ValueError as error:
        raise SourceError(f"transform of {child} in {parent}: {error}") from error


def registration(
    calibration: Calibration, colour: CameraInfo, depth_size: tuple[int, int]
) -> Registration | None:
    """Return the registration of depth to colour; None if depth is aligned.

    SourceError if depth has another size and no calibration, or the transform is not rigid.
    """
    if calibration.depth is None:
        if depth_size == (colour.height, colour.width):
            return None
        raise SourceError(
            f"depth is {depth_size[1]}x{depth_size[0]}, colour {colour.width}x{colour.height}: "
            "it cannot be aligned without a calibration of depth",
            "Give it as [depth] in a calibration file, or as options.depth_info_topic of a bag.",
        )
    colour_from_depth = np.eye(4)
    if calibration.rotation is not None:
        colour_from_depth[:3, :3] = calibration.rotation
    colour_from_depth[:3, 3] = calibration.translation_m
    depth = camera_info(calibration.depth, depth_size, "depth")
    static_transform("colour", "depth", colour_from_depth)  # checks that the transform is rigid
    return Registration(depth, colour, colour_from_depth, calibration.depth_offset_px)


def _from_table(table: Mapping[str, Any]) -> Calibration:
    """Read the fields of Calibration, or for colour only: fx, fy, cx, cy or Open3D's matrix."""
    if "intrinsic_matrix" in table:
        matrix, size = table["intrinsic_matrix"], (table["width"], table["height"])
        return Calibration(colour=to_intrinsics(_square(matrix), (), *size))
    if "fx" in table:
        table = {"colour": table}
    try:
        return msgspec.convert(table, Calibration)
    except msgspec.ValidationError as error:
        raise ValueError(f"{error}; expected fx, fy, cx and cy, or [colour] with them") from error


def _from_camera_info(table: Any) -> Calibration:
    """Read a file of ROS's camera calibration."""
    model = str(table.get("distortion_model", ""))
    colour = to_intrinsics(
        np.reshape(table["camera_matrix"]["data"], (3, 3)),
        read_distortion(model, table["distortion_coefficients"]["data"]),
        table["image_width"],
        table["image_height"],
        is_fisheye(model),
    )
    return Calibration(colour=colour)


def _from_matrix(text: str) -> Calibration:
    """Read a camera matrix of ScanNet, 7-Scenes or Stray Scanner, 3x3 or 4x4."""
    numbers = [float(word) for word in text.replace(",", " ").split()]
    return Calibration(colour=to_intrinsics(_square(numbers)))


def _square(numbers: Any) -> F64:
    """Return a 3x3 camera matrix from 9 or 16 numbers, row by row or column by column."""
    flat = np.ravel(np.asarray(numbers, np.float64))
    if flat.size not in (9, 16):
        raise ValueError(f"expected a matrix of 3x3 or 4x4, got {flat.size} numbers")
    matrix = flat.reshape(-1, 3 if flat.size == 9 else 4)[:3, :3]
    # The third row of a camera matrix is 0 0 1; in a transposed one it is the third column.
    matrix = matrix.T if not matrix[:2, 2].any() else matrix
    if not np.array_equal(matrix[2], (0.0, 0.0, 1.0)):
        raise ValueError(f"expected a camera matrix, got one with the third row {matrix[2]}")
    return matrix


def _from_npz(path: Path) -> Calibration:
    """Read K and the poses T_world_cam; the first pose is the mount."""
    arrays = read_arrays(path, ["K"], ["T_world_cam"])
    poses = arrays.get("T_world_cam")
    colour = to_intrinsics(arrays["K"])
    if poses is None:
        return Calibration(colour=colour)
    if poses.shape[1:] != (4, 4) or not len(poses):
        raise ValueError(f"T_world_cam: expected Nx4x4, got {poses.shape}")
    # A moving camera is on the base, which is at the origin at the start of the sequence.
    static = bool(np.allclose(poses, poses[:1], atol=1e-6))
    rows = tuple(tuple(row) for row in poses[0].tolist())
    return Calibration(
        colour=colour, parent="map" if static else "base_link", parent_from_optical=rows
    )


def _from_mat(path: Path) -> Calibration:
    arrays: Any = read_mat(path)
    colour, depth = (
        to_intrinsics(arrays[name]["K"], arrays[name]["DistCoef"]) for name in MAT_CAMERAS
    )
    return Calibration(
        colour=colour,
        depth=depth,
        rotation=tuple(map(tuple, arrays[MAT_ROTATION].tolist())),
        translation_m=tuple(arrays[MAT_TRANSLATION].ravel().tolist()),
    )


def to_intrinsics(
    matrix: F64, distortion: Any = (), width: int = 0, height: int = 0, fisheye: bool = False
) -> Intrinsics:
    """Return the intrinsics of a 3x3 camera matrix or of fx, fy, cx, cy."""
    matrix = np.asarray(matrix, np.float64)
    if matrix.shape == (3, 3):
        matrix = matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    fx, fy, cx, cy = matrix.tolist()
    numbers = tuple(float(k) for k in np.ravel(distortion))
    size = {"width": int(width), "height": int(height)}
    return Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, distortion=numbers, fisheye=fisheye, **size)


def renamed(
    transforms: Sequence[StaticTransform], own: str, frame_id: str
) -> list[StaticTransform]:
    """Return transforms with the camera's frame under its published name."""
    return [
        msgspec.structs.replace(
            transform, child=frame_id if transform.child == own else transform.child
        )
        for transform in transforms
    ]
