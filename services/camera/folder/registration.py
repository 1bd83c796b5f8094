"""Depth registered to colour (docs/method.md section 1)."""

import math

import cv2
import numpy as np
import numpy.typing as npt

from common.geometry.transforms import deproject
from people4d.messages import F64, U16, CameraInfo

F32 = npt.NDArray[np.float32]


class Registration:
    """Moves depth images into the view of the colour camera.

    Args:
        depth: Calibration of the depth camera.
        colour: Calibration of the colour camera.
        colour_from_depth: 4x4 rigid transform between their optical frames, metres.
        depth_offset_px: u, v added to depth pixels before deprojection: structured-light sensors
            shift depth relative to the infrared image used for calibration.

    Source: docs/method.md section 1.
    """

    def __init__(
        self,
        depth: CameraInfo,
        colour: CameraInfo,
        colour_from_depth: F64,
        depth_offset_px: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self._colour = colour
        self._shape = (depth.height, depth.width)
        v, u = np.mgrid[: depth.height, : depth.width].reshape(2, -1)
        pixels = np.column_stack([u, v]) + depth_offset_px
        rays = deproject(pixels, np.ones(len(pixels)), depth)
        # Point in the colour frame = z * ray + translation: only the ray needs the rotation.
        self._rays: F32 = np.ascontiguousarray((rays @ colour_from_depth[:3, :3].T).T, np.float32)
        self._translation_mm: F32 = (1000 * colour_from_depth[:3, 3]).astype(np.float32)
        # Neighbouring depth pixels leave gaps of this width in a finer colour image.
        scale = max(colour.fx / depth.fx, colour.fy / depth.fy)
        self._gap_px = max(0, math.ceil(scale - 0.05) - 1)

    def __call__(self, depth_mm: U16) -> U16:
        """Register one image; of two surfaces at one pixel, the nearer one counts.

        ValueError if the image has another size than the calibration.

        Args:
            depth_mm: HxW in millimetres, as measured, 0 = no reading.

        Returns:
            Depth in the size of colour [mm], along the optical axis of colour, 0 = no reading.
        """
        if depth_mm.shape != self._shape:
            raise ValueError(f"depth: expected shape {self._shape}, got {depth_mm.shape}")
        valid = np.flatnonzero(depth_mm)
        points = self._rays[:, valid] * depth_mm.ravel()[valid].astype(np.float32)
        points += self._translation_mm[:, None]
        u, v = self._pixels(points)
        inside = (u >= 0) & (u < self._colour.width) & (v >= 0) & (v < self._colour.height)
        inside &= (points[2] >= 1.0) & (points[2] < 65535.0)
        pixel = v[inside] * self._colour.width + u[inside]
        # 65535 marks an empty pixel of the z-buffer.
        buffer = np.full(self._colour.height * self._colour.width, 65535, np.uint16)
        np.minimum.at(buffer, pixel, np.rint(points[2, inside]).astype(np.uint16))
        registered = buffer.reshape(self._colour.height, self._colour.width)
        if self._gap_px:
            registered = self._close_gaps(registered)
        return np.where(registered == 65535, np.uint16(0), registered)

    def _pixels(self, points: F32) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        """Project 3xN points to integer pixels of colour, lens distortion applied."""
        colour = self._colour
        z = np.maximum(points[2], np.float32(1.0))
        x, y = points[0] / z, points[1] / z
        if colour.distortion:
            x, y = _distort(x, y, colour.distortion)
        u = np.rint(x * np.float32(colour.fx) + np.float32(colour.cx))
        v = np.rint(y * np.float32(colour.fy) + np.float32(colour.cy))
        # Far outside the lens model's range a pixel may not fit an integer.
        return (
            np.clip(u, -1, colour.width).astype(np.int32),
            np.clip(v, -1, colour.height).astype(np.int32),
        )

    def _close_gaps(self, registered: U16) -> U16:
        """Fill gaps between neighbouring readings without growing surfaces outward."""
        gap = self._gap_px
        kernel = np.ones((gap + 1, gap + 1), np.uint8)
        valid = (registered < 65535).astype(np.uint8)
        # Opposite anchors, since a kernel of even size shifts the surface.
        closed = cv2.erode(cv2.dilate(valid, kernel, anchor=(0, 0)), kernel, anchor=(gap, gap))
        gaps = (closed > 0) & (valid == 0)
        nearest = cv2.erode(registered, np.ones((2 * gap + 1, 2 * gap + 1), np.uint8))
        return np.where(gaps, nearest, registered).astype(np.uint16)


def _distort(x: F32, y: F32, coefficients: tuple[float, ...]) -> tuple[F32, F32]:
    """Apply lens distortion to normalised coordinates; OpenCV's order k1 k2 p1 p2 k3 k4 k5 k6."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (np.float32(k) for k in (*coefficients, *[0.0] * 8)[:8])
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    if len(coefficients) > 5:
        radial /= 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    xy = x * y
    return (
        x * radial + 2 * p1 * xy + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * xy,
    )
