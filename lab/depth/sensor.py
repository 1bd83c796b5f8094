"""Readings of a stereo depth camera, pixel by pixel, with the errors of config.py."""

import math
from typing import NamedTuple

import numpy as np

from common.compiled import compiled
from lab.depth.config import DepthSensorModel
from lab.depth.noise import NoiseField, Persistence, threshold
from lab.depth.registration import register
from people4d.messages import F32, U16, CameraInfo

SIGNAL_SPREAD = 0.35  # standard deviation of the logarithm of the minimum light (by eye)
KEY = 0xD435  # key of the random numbers


class DepthSensor:
    """Converts true depth to the readings of a depth camera.

    A reading depends on depth, seed and stamp only, not on earlier readings.
    """

    def __init__(self, config: DepthSensorModel, info: CameraInfo, seed: int) -> None:
        self._config = config
        self._info = info
        self._numbers = _numbers(config, info)
        self._stereo = StereoGeometry(
            focal_baseline=info.fx * config.baseline_m,
            gap_px=config.shadow_gap_px if config.shadow else math.inf,
            left_px=0.0 if config.left_band else -math.inf,
        )
        shape = (info.height, info.width)
        persistence = Persistence(
            frozen_share=config.frozen_share, correlation_s=config.correlation_s
        )
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
            name: NoiseField(shape, cell_px, (seed, KEY, number), persistence)
            for number, (name, cell_px) in enumerate(cells_px.items())
        }

    def measure(
        self, depth_m: F32, right_depth_m: F32 | None, stamp_s: float, light: F32 | None = None
    ) -> U16:
        """Return the readings in the view of the colour camera [mm], HxW, 0: none.

        Args:
            depth_m: HxW along the optical axis; 0, NaN or inf: no surface.
            right_depth_m: HxW in the view of the right imager, at the baseline to the right; None:
                reprojected from depth_m.
            stamp_s: Time of the frame.
            light: Returned light, HxW, see `infrared.returned`; None: sufficient everywhere.
        """
        matched = np.empty_like(depth_m)
        reading: U16 = np.empty(depth_m.shape, np.uint16)
        _match(depth_m, _right(depth_m, right_depth_m, self._stereo), self._stereo, matched)
        noise = NoiseImages(**{name: field.at(stamp_s) for name, field in self._fields.items()})
        if light is not None:
            matched[light < self._config.signal_least * np.exp(SIGNAL_SPREAD * noise.hole)] = 0
        _read(matched, noise, self._numbers, reading)
        offset_m = self._config.colour_offset_m
        return register(reading, offset_m, self._info) if offset_m else reading


class NoiseImages(NamedTuple):
    """Images of noise, HxW each, variance 1."""

    warp_u: F32
    warp_v: F32
    grain: F32
    patch: F32
    white: F32
    edge: F32
    hole: F32


class StereoGeometry(NamedTuple):
    """Position of the right imager's view in the image."""

    focal_baseline: float  # [px m] product of disparity and depth
    gap_px: float  # [px] minimum disparity of an occluding surface
    left_px: float  # [px] left edge of the right imager's view


class ReadingParameters(NamedTuple):
    """Parameters of the reading of a pixel."""

    focal_baseline: float  # [px m] product of the imagers' focal length and baseline
    slope: float  # [px] focal length in the image
    shift_u: float
    shift_v: float
    ragged: float
    grain: float
    patch: float
    white: float
    step: float
    edge_gap: float
    edge: float  # noise above which an edge has a hole
    hole: float  # noise above which another pixel has a hole
    grazing: float
    least: float
    most: float
    scale: float


def _numbers(config: DepthSensorModel, info: CameraInfo) -> ReadingParameters:
    white_share = max(1 - config.grain_share - config.patch_share, 0)
    return ReadingParameters(
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


def _right(depth_m: F32, right_depth_m: F32 | None, stereo: StereoGeometry) -> F32:
    disparity = np.zeros_like(depth_m)
    if right_depth_m is None:
        _reproject(depth_m, stereo.focal_baseline, disparity)
    else:
        valid = np.isfinite(right_depth_m) & (right_depth_m > 0)
        np.divide(stereo.focal_baseline, right_depth_m, out=disparity, where=valid)
    return disparity


@compiled
def _reproject(depth_m: F32, focal_baseline: float, disparity: F32) -> None:
    """Project the left view into the right view; the nearest surface wins."""
    height, width = depth_m.shape
    for v in range(height):
        for u in range(width):
            z = depth_m[v, u]
            if not 0 < z < math.inf:
                continue
            d = focal_baseline / z
            left = math.floor(u - d)
            # Two columns, so that surfaces stretched in the right view have no cracks
            for column in range(max(left, 0), min(left + 2, width)):
                disparity[v, column] = max(disparity[v, column], d)


@compiled
def _match(depth_m: F32, right: F32, stereo: StereoGeometry, matched: F32) -> None:
    """Copy the depth of surfaces that both imagers see; else 0."""
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


@compiled
def _read(matched: F32, noise: NoiseImages, numbers: ReadingParameters, reading: U16) -> None:
    height, width = matched.shape
    for v in range(height):
        for u in range(width):
            reading[v, u] = 0
            # Ragged silhouettes: the reading of a nearby pixel
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


@compiled
def _is_hole(
    matched: F32, y: int, x: int, edge: float, hole: float, numbers: ReadingParameters
) -> bool:
    height, width = matched.shape
    z = matched[y, x]
    up, down = matched[max(y - 1, 0), x], matched[min(y + 1, height - 1), x]
    left, right = matched[y, max(x - 1, 0)], matched[y, min(x + 1, width - 1)]
    least, most = min(up, down, left, right, z), max(up, down, left, right, z)
    if least == 0 or most - least > numbers.edge_gap * z:
        return edge > numbers.edge
    # Approximate tangent of the angle of view: steep surfaces match badly
    slope = numbers.slope / z * max(abs(right - left), abs(down - up)) / 2 / numbers.grazing
    return numbers.hole < math.inf and hole > numbers.hole * (1 - slope * slope)
