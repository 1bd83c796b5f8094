"""Messages of the camera: frames, calibration, transforms and odometry."""

from typing import Annotated

import numpy as np
from msgspec import Meta

from people4d.messages.base import (
    MAX_PX,
    U16,
    ImageSide,
    Matrix3,
    Matrix4,
    Message,
    Metres,
    Name,
    Radians,
    RgbImage,
    Vector3,
    check_size,
)
from people4d.validation import Shape

FocalLength = Annotated[float, Meta(ge=1, le=1e5)]
Pixel = Annotated[float, Meta(ge=-MAX_PX, le=MAX_PX)]
Coefficient = Annotated[float, Meta(ge=-1e4, le=1e4)]
Range = Annotated[float, Meta(gt=0, le=1e3)]
DISTORTION_LENGTHS = {"none": (0,), "plumb_bob": (4, 5), "rational_polynomial": (8,)}


class CameraInfo(Message, frozen=True, kw_only=True):
    """Calibration of one camera; depth is aligned to colour, so one pinhole serves both."""

    camera: Name  # name of the camera
    frame_id: Name  # name of its optical frame: x right, y down, z forward
    width: ImageSide  # [px] width of the images
    height: ImageSide  # [px] height of the images
    fx: FocalLength  # [px] focal length, horizontal
    fy: FocalLength  # [px] focal length, vertical
    cx: Pixel  # [px] principal point, horizontal
    cy: Pixel  # [px] principal point, vertical
    distortion_model: str = "none"  # "none", "plumb_bob" (4 or 5) or "rational_polynomial" (8)
    # coefficients in OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6
    distortion: tuple[Coefficient, ...] = ()
    max_depth_m: Range = 5.0  # [m] maximum depth of valid readings

    def __post_init__(self) -> None:
        """Check that the calibration can be used."""
        super().__post_init__()
        check_size(self.width, self.height)
        lengths = DISTORTION_LENGTHS.get(self.distortion_model)
        if lengths is None:
            names = ", ".join(DISTORTION_LENGTHS)
            raise ValueError(
                f"distortion_model: expected one of {names}, got {self.distortion_model!r}"
            )
        if len(self.distortion) not in lengths:
            raise ValueError(
                f"distortion: expected {' or '.join(map(str, lengths))} numbers for "
                f"{self.distortion_model}, got {len(self.distortion)}"
            )


class RgbdFrame(Message, frozen=True, kw_only=True):
    """One colour image with the depth image aligned to it."""

    camera: Name  # name of the camera
    rgb: RgbImage  # red first
    depth_mm: Annotated[U16, Shape("H", "W")]  # [mm] aligned to rgb, 0 = no reading
    lockstep: bool = False  # True: no consumer may skip this frame; False: the newest frame wins

    def __post_init__(self) -> None:
        """Check that the two images have the same size."""
        super().__post_init__()
        if self.depth_mm.shape != self.rgb.shape[:2]:
            raise ValueError(
                f"depth_mm: expected the size of rgb, {self.rgb.shape[:2]}, "
                f"got {self.depth_mm.shape}"
            )


class CompressedRgbdFrame(Message, frozen=True, kw_only=True):
    """An RGB-D frame for recordings and slow links: JPEG colour and 16-bit PNG depth."""

    camera: Name  # name of the camera
    rgb_jpeg: bytes  # JPEG, HxWx3
    depth_png: bytes  # [mm] PNG, HxW, 16 bits, aligned to rgb, 0 = no reading

    def __post_init__(self) -> None:
        """Check the file signatures."""
        super().__post_init__()
        if not self.rgb_jpeg.startswith(b"\xff\xd8\xff"):
            raise ValueError("rgb_jpeg: expected a JPEG file, got other bytes")
        if not self.depth_png.startswith(b"\x89PNG\r\n\x1a\n"):
            raise ValueError("depth_png: expected a PNG file, got other bytes")


class StaticTransform(Message, frozen=True, kw_only=True):
    """A rigid transform that does not change: parent_from_child."""

    parent: Name  # name of the target frame, for example "map"
    child: Name  # name of the source frame, for example the optical frame
    matrix: Matrix4  # [m] homogeneous; a point p in child is matrix @ p in parent

    def __post_init__(self) -> None:
        """Check that the matrix is a rigid transform."""
        super().__post_init__()
        _check_rigid(self)


class MovingTransform(Message, frozen=True, kw_only=True):
    """A rigid transform at one time, for example of a pan-tilt head: parent_from_child."""

    parent: Name  # name of the target frame, for example "base_link"
    child: Name  # name of the source frame, for example "head"
    matrix: Matrix4  # [m] homogeneous; a point p in child is matrix @ p in parent

    def __post_init__(self) -> None:
        """Check that the matrix is a rigid transform."""
        super().__post_init__()
        _check_rigid(self)


class Odometry(Message, frozen=True, kw_only=True):
    """Pose of the moving base, from its wheels or from visual odometry."""

    frame_id: Name  # frame of the pose, for example "odom"
    child_frame_id: Name  # frame of the base, for example "base_link"
    x_m: Metres  # [m] frame: frame_id, forward at start
    y_m: Metres  # [m] frame: frame_id, left at start
    theta_rad: Radians  # [rad] yaw, counter-clockwise, in (-pi, pi]
    covariance: Matrix3 | None = None  # [m, rad] of x, y, theta; absent if unknown
    # [m/s, rad/s] vx, vy, omega in child_frame_id; absent if unknown
    twist: Vector3 | None = None


def _check_rigid(transform: StaticTransform | MovingTransform) -> None:
    rotation, last = transform.matrix[:3, :3], transform.matrix[3]
    orthonormal = np.all(np.abs(rotation) < 2) and np.allclose(
        rotation @ rotation.T, np.eye(3), atol=1e-4
    )
    if not orthonormal or np.linalg.det(rotation) < 0 or np.any(last != (0, 0, 0, 1)):
        raise ValueError("matrix: expected a rotation and a translation, got another matrix")
