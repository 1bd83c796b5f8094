"""Floor in view of a camera, from depth: direction up and height of the camera.

The floor is the plane at people's feet, so a table, a shelf or a wall is excluded. It follows from
the depth of some hundred pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F64, U16, CameraInfo

PIXELS = 80  # longer side of a thinned image [px]
IMAGES_MIN = 3  # minimum number of images of a camera
READ_MIN = 0.3  # minimum share of the images in which a pixel has a reading
GATES_M = (0.25, 0.15, 0.08)  # maximum distance from the plane, by round
NOISE_M, NOISE_PER_M = (
    0.01,
    0.004,
)  # standard deviation of a pixel's median at depth z: s + k z^2 [m]
PIXELS_MIN = 150  # minimum number of pixels on the floor
EXTENT_MIN_M = 0.2  # minimum standard deviation of their positions along either direction
ALIKE = 5.0  # number of neighbouring pixels with a correlated error
TILT_MAX = np.radians(3)  # maximum tilt from the direction up of people
HEIGHT_SIGMA = 0.005  # relative standard deviation of the camera's height: the scale of depth
TILT_SIGMA_RAD = 0.003  # standard deviation of the tilt


@dataclass(frozen=True, slots=True)
class MeasuredFloor:
    """The floor in the optical frame of a camera, or of the reference."""

    up: F64  # 3, unit length
    middle_m: F64  # 3, the most certain point of the floor
    sigma_m: float  # standard deviation of the height of middle_m
    sigma_rad: float  # standard deviation of the direction up

    @property
    def camera_m(self) -> float:
        """Height of the origin above the floor."""
        return -float(self.up @ self.middle_m)


def thinned(depth_mm: U16) -> U16:
    """Return a depth image reduced to every n-th pixel, for `find_floor`."""
    step = _step_px(depth_mm.shape)
    return np.ascontiguousarray(depth_mm[::step, ::step])


def find_floor(
    images_mm: Sequence[U16], info: CameraInfo, up: F64, camera_m: float
) -> MeasuredFloor | None:
    """Return the floor in the depth of a static camera; None if no floor is in view.

    Args:
        images_mm: Depth of some images by `thinned`, 0 = no reading.
        info: Calibration of the camera.
        up: Direction up by people, optical frame.
        camera_m: Height of the camera above their feet [m].
    """
    points = _background_m(images_mm, info)
    sigmas = NOISE_M + NOISE_PER_M * points[:, 2] ** 2
    middle, normal = -camera_m * up, up
    for gate_m in GATES_M:
        near = np.abs((points - middle) @ normal) < gate_m + sigmas
        if near.sum() < PIXELS_MIN:
            return None
        middle, normal, extent_m, rms_m = _fit(points[near], sigmas[near])
        normal = normal if normal @ up > 0 else -normal
        if extent_m < EXTENT_MIN_M or normal @ up < np.cos(TILT_MAX):
            return None
    error_m = rms_m * np.sqrt(ALIKE / near.sum())
    return MeasuredFloor(
        up=normal,
        middle_m=middle,
        sigma_m=float(np.hypot(error_m, HEIGHT_SIGMA * (middle @ normal))),
        sigma_rad=float(np.hypot(error_m / extent_m, TILT_SIGMA_RAD)),
    )


def _step_px(shape: tuple[int, ...]) -> int:
    return max(max(shape) // PIXELS, 1)


def _background_m(images_mm: Sequence[U16], info: CameraInfo) -> F64:
    """Return the background points (Nx3) of a camera."""
    step = _step_px((info.height, info.width))
    shape = -(-info.height // step), -(-info.width // step)
    fitting = [image for image in images_mm if image.shape == shape]
    if len(fitting) < IMAGES_MIN:
        return np.zeros((0, 3))
    stack = np.array(fitting, np.float64) / 1000
    stack[(stack <= 0) | (stack > info.max_depth_m)] = np.nan
    rows, columns = np.nonzero(np.isfinite(stack).mean(axis=0) >= READ_MIN)
    pixels = np.column_stack([columns, rows]) * step
    return deproject(pixels, np.nanmedian(stack[:, rows, columns], axis=0), info)


def _fit(points: F64, sigmas: F64) -> tuple[F64, F64, float, float]:
    """Return middle, normal, least extent and RMS distance of the plane through points."""
    weights = sigmas**-2 / (sigmas**-2).sum()
    middle = weights @ points
    apart = points - middle
    values, vectors = np.linalg.eigh(apart.T @ (apart * weights[:, None]))
    normal = vectors[:, 0]
    rms_m = float(np.sqrt(((apart @ normal) ** 2).mean()))
    return middle, normal, float(np.sqrt(max(values[1], 0.0))), rms_m
