"""Checked and copied images from a user program."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from common.calibration.transforms_file import MAP
from common.diagnosis.event_table import REJECTED
from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from people4d.errors import SourceError
from people4d.messages import F64, U8, CameraInfo
from people4d.messages.base import MAX_STAMP_NS, check_name
from services.camera.alignment import ImageAlignment, align
from services.camera.calibration import (
    Calibration,
    Intrinsics,
    camera_info,
    static_transform,
    to_intrinsics,
)
from services.camera.frame_check import FrameCheck
from services.camera.source import SourceFrame

IMAGES = (
    "Give rgb as HxWx3 uint8, red first, and depth as HxW: uint16 millimetres or float metres; "
    "the first frame sets the size."
)
ORDER = "Give each frame once, oldest first; a new recording needs a new Pipeline or Camera."


def mount(
    x_m: float = 0.0, y_m: float = 0.0, z_m: float = 0.0, rpy_rad: Sequence[float] = (0.0, 0.0, 0.0)
) -> F64:
    """Return the pose (4x4) of a camera from the position and rotation of its body.

    Args:
        x_m: Forward in the parent frame [m].
        y_m: To the left [m].
        z_m: Upward [m].
        rpy_rad: Roll, pitch and yaw [rad] of the body (x forward, y left, z up) about fixed axes;
            a positive pitch looks down.
    """
    return transform_from((x_m, y_m, z_m), rotation_from_rpy(*rpy_rad)) @ LINK_FROM_OPTICAL


class CameraImages:
    """Checks the images of a camera; the first ones define the size.

    SourceError if name, intrinsics, pose or range are impossible.

    Args:
        name: Name of the camera.
        intrinsics: Lens of the colour image, or its camera matrix (3x3) without distortion.
        pose: Pose (4x4) of the optical frame (x right, y down, z forward) in `parent` [m]; None:
            level at the origin.
        parent: Frame of the pose.
        max_depth_m: Larger readings of depth are not used [m].
    """

    def __init__(
        self,
        name: str,
        intrinsics: Intrinsics | npt.ArrayLike,
        pose: npt.ArrayLike | None = None,
        parent: str = MAP,
        max_depth_m: float = 5.0,
    ) -> None:
        self.name, self._max_depth_m = name, max_depth_m
        frame = f"{name}_optical_frame"
        try:
            self._intrinsics = _to_intrinsics(intrinsics)
            matrix = mount() if pose is None else np.asarray(pose, np.float64)
            # The first images define the size; all else is checked before them.
            lens = msgspec.structs.replace(self._intrinsics, fisheye=False, width=0, height=0)
            self._own_info(camera_info(lens, (1, 1)))
            check_name("frame", frame)
        except (TypeError, ValueError) as error:
            raise SourceError(f"camera {name!r}: {error}") from error
        self.transform = static_transform(parent, frame, matrix)
        self._alignment: ImageAlignment | None = None
        self._stamp_ns: int | None = None  # acquisition time of the last frame [ns]

    @property
    def info(self) -> CameraInfo | None:
        """Calibration; None before the first images."""
        return self._alignment.info if self._alignment else None

    def accept(self, rgb: U8, depth: npt.NDArray[Any], stamp_ns: int) -> SourceFrame:
        """Return a copy of a frame, aligned; SourceError, and no change, if it is invalid."""
        alignment = self._alignment or self._align(rgb)
        check = FrameCheck(
            alignment.info, np.issubdtype(getattr(depth, "dtype", np.uint16), np.floating)
        )
        frame = check.accept(SourceFrame(rgb, depth, stamp_ns))
        if not isinstance(frame, SourceFrame):
            hint = REJECTED[check.cause] if check.cause == "wrong_stamp" else IMAGES
            fault = check.fault.replace("depth_mm", "depth")  # name of the argument
            raise SourceError(f"camera {self.name}: {fault}", hint)
        if abs(stamp_ns) > MAX_STAMP_NS:
            problem = f"camera {self.name}: stamp_ns: expected +-2**62 at most, got {stamp_ns}"
            raise SourceError(problem, REJECTED["wrong_stamp"])
        if self._stamp_ns is not None and stamp_ns <= self._stamp_ns:
            ago_s = (self._stamp_ns - stamp_ns) / 1e9
            order = f"is {ago_s:g} s older than" if ago_s else "has the stamp of"
            raise SourceError(f"camera {self.name}: a frame {order} the one before", ORDER)
        images = alignment(frame.rgb.copy(), frame.depth_mm.copy())
        self._alignment, self._stamp_ns = alignment, stamp_ns
        return SourceFrame(*images, stamp_ns)

    def _align(self, rgb: U8) -> ImageAlignment:
        shape: tuple[int, ...] = getattr(rgb, "shape", ())
        if len(shape) < 2:
            raise SourceError(f"camera {self.name}: rgb is not an image", IMAGES)
        size = (shape[0], shape[1])
        calibration = Calibration(colour=self._intrinsics)
        alignment = align(calibration, self._intrinsics, size, size, self.transform.child)
        return replace(alignment, info=self._own_info(alignment.info))

    def _own_info(self, info: CameraInfo) -> CameraInfo:
        return msgspec.structs.replace(info, camera=self.name, max_depth_m=self._max_depth_m)


def _to_intrinsics(given: Intrinsics | npt.ArrayLike) -> Intrinsics:
    if isinstance(given, Intrinsics):
        return given
    matrix = np.asarray(given, np.float64)
    if matrix.shape != (3, 3) or matrix[2].tolist() != [0.0, 0.0, 1.0]:
        raise ValueError("expected Intrinsics, or a 3x3 camera matrix with the last row 0 0 1")
    return to_intrinsics(matrix)
