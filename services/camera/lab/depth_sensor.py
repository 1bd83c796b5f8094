"""A depth camera made of two imagers, like the Intel RealSense D435i, depth aligned to colour.

Such a camera matches the pictures of two imagers a baseline b apart. What it measures is the
disparity d = f b / z, so an error of s pixels in d is one of z^2 s / (f b) in z: the RMS error
grows with the square of the distance. Intel's guide to tuning the D400 series states this law, with
s below 0.1 px on well textured surfaces; the data sheet promises at most 2 % at 2 m, and a user who
put a D435 before a wall at 2.2 m reports s = 0.06 to 0.07 (librealsense, question 3139). The
defaults, s = 0.07 px, f = 385 px and b = 50 mm, give 3.6 mm at 1 m, 15 mm (0.7 %) at 2 m, 33 mm at
3 m and 58 mm (1.5 %) at 4 m.

How noise divides into smooth and white, frozen and running, and how ragged silhouettes are, is
chosen by eye, not measured on a camera. What is not simulated: texture (a white wall is matched as
well as a shirt), sunlight, glass and mirrors, rolling temperature drift.
"""

import math
from typing import NamedTuple

import msgspec
import numpy as np
from numba import njit

from common.messages import F32, U16, CameraInfo
from services.camera.lab.noise import Field, Persistence, threshold

KEY = 0xD435  # sets these random numbers apart from others of the same seed


class DepthSensorConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The errors of a depth camera; the defaults resemble a D435i in a room."""

    baseline_m: float = 0.050  # [m] between the imagers, the right one to the right; D435i: 50 mm
    focal_px: float = 385.0  # [px] of the imagers, whose disparity is measured; D435i at 640x480
    noise_px: float = 0.07  # [px] RMS error of disparity; measured 0.06 to 0.07 (see above)
    grain_share: float = 0.45  # of its variance that is smooth over `grain_px` (default by eye)
    patch_share: float = 0.25  # of its variance that is smooth over `patch_px`; the rest is white
    grain_px: int = 6  # [px] about the window in which imagers are matched
    patch_px: int = 18  # [px]
    step_px: float = 1 / 32  # [px] disparity is a multiple of this; D400: 1/32; 0: not rounded
    frozen_share: float = 0.35  # of the variance of all noise that never changes (by eye)
    correlation_s: float = 0.1  # [s] how long the other noise lasts, see `noise.Persistence`
    ragged_px: float = 1.2  # [px] RMS sideways error of silhouettes (by eye)
    ragged_cell_px: int = 4  # [px] size of the teeth of silhouettes
    shadow: bool = True  # no reading where the right imager's view is blocked
    shadow_gap_px: float = 1.0  # [px] of disparity that the blocking surface is nearer
    left_band: bool = True  # no reading left of the right imager's view, if as wide as colour's
    edge_gap: float = 0.04  # a step in depth of this share of the depth is an edge
    edge_holes: float = 0.4  # share of pixels at edges and beside shadows without reading (by eye)
    holes: float = 0.006  # share of other pixels without reading, in blobs: dark, shiny (by eye)
    hole_px: int = 9  # [px] size of the blobs
    grazing_tan: float = 8.0  # tangent of the angle of view at which half the readings fail
    min_depth_m: float = 0.28  # [m] nearer gives no reading; D435i
    max_depth_m: float = 5.0  # [m] farther gives no reading; as the paper cuts it
    scale_bias: float = 0.0  # readings are larger by this share, as after a bad calibration
    shift_px: tuple[float, float] = (0.0, 0.0)  # [px] of depth against colour: right, down

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            ValueError: A value is out of range.
        """
        for name in ("baseline_m", "focal_px", "correlation_s", "grazing_tan"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected > 0, got {getattr(self, name)}")
        for name in ("noise_px", "step_px", "ragged_px", "shadow_gap_px", "edge_gap"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected >= 0, got {getattr(self, name)}")
        for name in ("grain_share", "patch_share", "frozen_share", "edge_holes", "holes"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name}: expected 0 to 1, got {getattr(self, name)}")
        for name in ("grain_px", "patch_px", "ragged_cell_px", "hole_px"):
            if not 1 <= getattr(self, name) <= 256:
                raise ValueError(f"{name}: expected 1 to 256, got {getattr(self, name)}")
        if self.grain_share + self.patch_share > 1:
            raise ValueError("grain_share + patch_share: expected at most 1")
        if not 0 <= self.min_depth_m < self.max_depth_m <= 65.5:
            raise ValueError("min_depth_m, max_depth_m: expected 0 <= min < max <= 65.5")
        if not -0.5 < self.scale_bias < 0.5 or not max(map(abs, self.shift_px)) <= 64:
            raise ValueError("scale_bias: expected within 0.5; shift_px: within 64")

    def noise_m(self, depth_m: float) -> float:
        """Return the standard deviation of a reading at a depth, without rounding."""
        return depth_m**2 * self.noise_px / (self.focal_px * self.baseline_m)


EXACT = DepthSensorConfig(
    noise_px=0,
    step_px=0,
    ragged_px=0,
    shadow=False,
    left_band=False,
    edge_holes=0,
    holes=0,
    min_depth_m=0,
    max_depth_m=65.5,
)  # reads whole millimetres and makes no other error


class DepthSensor:
    """Turns the true depth of each pixel into what a depth camera reads.

    A reading depends on the depth, the seed and the stamp only, never on what was read before.

    Args:
        config: Which errors it makes.
        info: Calibration of the image.
        seed: Of its random numbers.
    """

    def __init__(self, config: DepthSensorConfig, info: CameraInfo, seed: int) -> None:
        self._config = config
        self._numbers = _numbers(config, info)
        self._stereo = Stereo(
            focal_baseline=info.fx * config.baseline_m,
            gap_px=config.shadow_gap_px if config.shadow else math.inf,
            left_px=0.0 if config.left_band else -math.inf,
        )
        shape = (info.height, info.width)
        lasting = Persistence(frozen_share=config.frozen_share, correlation_s=config.correlation_s)
        cells_px = {
            "warp_u": config.ragged_cell_px,
            "warp_v": config.ragged_cell_px,
            "grain": config.grain_px,
            "patch": config.patch_px,
            "white": 1,
            "edge": max(config.hole_px // 2, 1),
            "hole": config.hole_px,
        }
        self._fields = {
            name: Field(shape, cell_px, (seed, KEY, number), lasting)
            for number, (name, cell_px) in enumerate(cells_px.items())
        }

    def measure(self, depth_m: F32, right_depth_m: F32 | None, stamp_s: float) -> U16:
        """Return what the camera reads.

        Args:
            depth_m: HxW along the optical axis; 0, NaN or inf where nothing is.
            right_depth_m: HxW as the right imager sees it, the colour camera moved to the right
                by the baseline; None: what follows from depth_m.
            stamp_s: When.

        Returns:
            HxW in millimetres, 0 where there is no reading.
        """
        matched = np.empty_like(depth_m)
        reading: U16 = np.empty(depth_m.shape, np.uint16)
        _match(depth_m, _right(depth_m, right_depth_m, self._stereo), self._stereo, matched)
        noise = Fields(**{name: field.at(stamp_s) for name, field in self._fields.items()})
        _read(matched, noise, self._numbers, reading)
        return reading


class Fields(NamedTuple):
    """Images of noise, HxW each, variance 1."""

    warp_u: F32
    warp_v: F32
    grain: F32
    patch: F32
    white: F32
    edge: F32
    hole: F32


class Stereo(NamedTuple):
    """How the view of the right imager lies to the image."""

    focal_baseline: float  # [px m] disparity in the image is this by depth
    gap_px: float  # [px] a surface nearer by this blocks the view
    left_px: float  # [px] where the view of the right imager begins


class Numbers(NamedTuple):
    """What the reading of a pixel depends on besides noise."""

    focal_baseline: float  # [px m] of the imagers
    slope: float  # [px] focal length in the image
    shift_u: float
    shift_v: float
    ragged: float
    grain: float
    patch: float
    white: float
    step: float
    edge_gap: float
    edge: float  # noise above this is a hole at an edge
    hole: float  # and elsewhere
    grazing: float
    least: float
    most: float
    scale: float


def _numbers(config: DepthSensorConfig, info: CameraInfo) -> Numbers:
    white_share = max(1 - config.grain_share - config.patch_share, 0)
    return Numbers(
        focal_baseline=config.focal_px * config.baseline_m,
        slope=info.fx,
        shift_u=config.shift_px[0],
        shift_v=config.shift_px[1],
        ragged=config.ragged_px,
        grain=config.noise_px * math.sqrt(config.grain_share),
        patch=config.noise_px * math.sqrt(config.patch_share),
        white=config.noise_px * math.sqrt(white_share),
        step=config.step_px,
        edge_gap=config.edge_gap,
        edge=threshold(config.edge_holes),
        hole=threshold(config.holes),
        grazing=config.grazing_tan,
        least=config.min_depth_m,
        most=config.max_depth_m,
        scale=1 + config.scale_bias,
    )


def _right(depth_m: F32, right_depth_m: F32 | None, stereo: Stereo) -> F32:
    """Return the disparity that the right imager sees, 0 where it sees nothing."""
    disparity = np.zeros_like(depth_m)
    if right_depth_m is None:
        _reproject(depth_m, stereo.focal_baseline, disparity)
    else:
        seen = np.isfinite(right_depth_m) & (right_depth_m > 0)
        np.divide(stereo.focal_baseline, right_depth_m, out=disparity, where=seen)
    return disparity


@njit(cache=True, nogil=True)
def _reproject(depth_m: F32, focal_baseline: float, disparity: F32) -> None:
    """Draw the left view into the right one; the nearest surface, of largest disparity, stays."""
    height, width = depth_m.shape
    for v in range(height):
        for u in range(width):
            z = depth_m[v, u]
            if not 0 < z < math.inf:
                continue
            d = focal_baseline / z
            left = math.floor(u - d)
            # Two columns, so that a surface that is stretched in the right view has no cracks.
            for column in range(max(left, 0), min(left + 2, width)):
                disparity[v, column] = max(disparity[v, column], d)


@njit(cache=True, nogil=True)
def _match(depth_m: F32, right: F32, stereo: Stereo, matched: F32) -> None:
    """Keep the depth of what both imagers see, else 0."""
    height, width = depth_m.shape
    for v in range(height):
        for u in range(width):
            z = depth_m[v, u]
            matched[v, u] = 0
            if not 0 < z < math.inf:
                continue
            d = stereo.focal_baseline / z
            column = round(u - d)
            if u - d < stereo.left_px:
                continue
            if 0 <= column < width and right[v, column] > d + stereo.gap_px:
                continue
            matched[v, u] = z


@njit(cache=True, nogil=True)
def _read(matched: F32, noise: Fields, numbers: Numbers, reading: U16) -> None:
    height, width = matched.shape
    for v in range(height):
        for u in range(width):
            reading[v, u] = 0
            # Ragged silhouettes: the reading of a place nearby.
            y = round(v - numbers.shift_v + numbers.ragged * noise.warp_v[v, u])
            x = round(u - numbers.shift_u + numbers.ragged * noise.warp_u[v, u])
            y, x = min(max(y, 0), height - 1), min(max(x, 0), width - 1)
            z = matched[y, x]
            if z == 0 or _is_hole(matched, y, x, noise.edge[v, u], noise.hole[v, u], numbers):
                continue
            error = (
                numbers.grain * noise.grain[v, u]
                + numbers.patch * noise.patch[v, u]
                + numbers.white * noise.white[v, u]
            )
            d = numbers.focal_baseline / z + error
            if numbers.step > 0:
                d = round(d / numbers.step) * numbers.step
            if d <= 0:
                continue
            z = numbers.focal_baseline / d * numbers.scale
            if numbers.least <= z <= numbers.most:
                reading[v, u] = round(z * 1000)


@njit(cache=True, nogil=True)
def _is_hole(matched: F32, y: int, x: int, edge: float, hole: float, numbers: Numbers) -> bool:
    height, width = matched.shape
    z = matched[y, x]
    up, down = matched[max(y - 1, 0), x], matched[min(y + 1, height - 1), x]
    left, right = matched[y, max(x - 1, 0)], matched[y, min(x + 1, width - 1)]
    least, most = min(up, down, left, right, z), max(up, down, left, right, z)
    if least == 0 or most - least > numbers.edge_gap * z:
        return edge > numbers.edge
    # Tangent of the angle between view and surface normal, about: steep surfaces match badly.
    slope = numbers.slope / z * max(abs(right - left), abs(down - up)) / 2 / numbers.grazing
    return numbers.hole < math.inf and hole > numbers.hole * (1 - slope * slope)
