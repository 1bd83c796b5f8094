"""Alignment of images: colour and depth as one pinhole camera would see them."""

from dataclasses import dataclass
from typing import cast

import cv2
import msgspec
import numpy as np

from common.ros2.frame_names import OPTICAL_FRAME
from people4d.errors import SourceError
from people4d.messages import U8, U16, CameraInfo
from services.camera.calibration import Calibration, Intrinsics, camera_info, registration
from services.camera.folder.registration import Registration


class FisheyeLens:
    """Removal of an equidistant lens's distortion, by maps that are made once.

    The coefficients have the order of cv2.fisheye and of the model `equidistant` in ROS.
    SourceError if the coefficients give no image.

    Args:
        intrinsics: Intrinsics with 4 coefficients.
        size: Height and width of the images [px].
    """

    def __init__(self, intrinsics: Intrinsics, size: tuple[int, int]) -> None:
        matrix = np.eye(3)
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] = (
            *(intrinsics.fx, intrinsics.fy),
            *(intrinsics.cx, intrinsics.cy),
        )
        coefficients = np.array(intrinsics.distortion, np.float64)
        shape = size[::-1]
        pinhole = cv2.fisheye.estimateNewCameraMatrixForUndistortRectify(
            matrix, coefficients, shape, np.eye(3), balance=0.0
        )
        fx, fy, cx, cy = pinhole[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        if not (np.isfinite(pinhole).all() and fx > 0 and fy > 0):
            raise SourceError(
                f"calibration: coefficients {intrinsics.distortion} of a fisheye lens give no image"
            )
        self.pinhole = msgspec.structs.replace(
            intrinsics, fx=fx, fy=fy, cx=cx, cy=cy, distortion=(), fisheye=False
        )
        self._maps = cv2.fisheye.initUndistortRectifyMap(
            matrix, coefficients, np.eye(3), pinhole, shape, cv2.CV_32FC1
        )

    def colour(self, rgb: U8) -> U8:
        """Return a colour image (HxWx3) without distortion."""
        return cast(U8, cv2.remap(rgb, *self._maps, cv2.INTER_LINEAR))

    def depth(self, depth_mm: U16) -> U16:
        """Return a depth image (HxW, 0: no reading) without distortion; readings are not mixed."""
        return cast(U16, cv2.remap(depth_mm, *self._maps, cv2.INTER_NEAREST))


@dataclass(frozen=True)
class ImageAlignment:
    """Steps from the images of a camera to aligned images of a pinhole."""

    info: CameraInfo  # calibration of the aligned images
    registration: Registration | None  # registration of depth; None: depth has the pixels of colour
    lens: FisheyeLens | None  # fisheye lens; None: a pinhole with or without distortion

    def __call__(self, rgb: U8, depth_mm: U16) -> tuple[U8, U16]:
        """Return colour and depth, aligned.

        ValueError if the depth image has another size than the calibration of depth.
        """
        if self.registration:
            depth_mm = self.registration(depth_mm)
        elif self.lens:
            depth_mm = self.lens.depth(depth_mm)
        return (self.lens.colour(rgb) if self.lens else rgb), depth_mm


def align(
    calibration: Calibration,
    colour: Intrinsics,
    size: tuple[int, int],
    depth_size: tuple[int, int],
    frame_id: str = OPTICAL_FRAME,
) -> ImageAlignment:
    """Return the alignment of a camera's images.

    SourceError if the calibration does not fit the images or cannot be used.

    Args:
        calibration: Calibration of the camera.
        colour: Intrinsics of its colour camera.
        size: Height and width of colour images [px].
        depth_size: Height and width of depth images [px].
        frame_id: Optical frame of colour.
    """
    lens = FisheyeLens(colour, size) if colour.fisheye else None
    info = camera_info(lens.pinhole if lens else colour, size, frame_id)
    return ImageAlignment(info, registration(calibration, info, depth_size), lens)
