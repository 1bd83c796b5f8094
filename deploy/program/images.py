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
from people4d.messages.base import MAX_STAMP_NS
from services.camera.alignment import ImageAlignment, align
from services.camera.calibration import Calibration, Intrinsics, static_transform, to_intrinsics
from services.camera.frame_check import FrameCheck
from services.camera.source import SourceFrame


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

    SourceError if intrinsics or pose are impossible.

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
        if not isinstance(intrinsics, Intrinsics):
            intrinsics = to_intrinsics(np.asarray(intrinsics, np.float64))
        matrix = mount() if pose is None else np.asarray(pose, np.float64)
        self.name, self._intrinsics, self._max_depth_m = name, intrinsics, max_depth_m
        self.transform = static_transform(parent, f"{name}_optical_frame", matrix)
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
            raise SourceError(f"camera {self.name}: {check.fault}", REJECTED[check.cause])
        if abs(stamp_ns) > MAX_STAMP_NS:
            problem = f"camera {self.name}: stamp_ns: expected +-2**62 at most, got {stamp_ns}"
            raise SourceError(problem, REJECTED["wrong_stamp"])
        if self._stamp_ns is not None and stamp_ns <= self._stamp_ns:
            ago_s = (self._stamp_ns - stamp_ns) / 1e9
            problem = f"camera {self.name}: a frame is {ago_s:g} s older than the one before"
            raise SourceError(
                problem, "Give the oldest first; a new recording needs a new Pipeline or Camera."
            )
        images = alignment(frame.rgb.copy(), frame.depth_mm.copy())
        self._alignment, self._stamp_ns = alignment, stamp_ns
        return SourceFrame(*images, stamp_ns)

    def _align(self, rgb: U8) -> ImageAlignment:
        if np.ndim(rgb) < 2:
            raise SourceError(f"camera {self.name}: rgb is not an image", "Give HxWx3, red first.")
        size = (np.shape(rgb)[0], np.shape(rgb)[1])
        calibration = Calibration(colour=self._intrinsics)
        alignment = align(calibration, self._intrinsics, size, size, self.transform.child)
        info = msgspec.structs.replace(
            alignment.info, camera=self.name, max_depth_m=self._max_depth_m
        )
        return replace(alignment, info=info)
