"""Depth images by random sensors: stereo, structured light and time of flight."""

import cv2
import msgspec
import numpy as np

from lab.depth.config import SENSORS, SensorName
from lab.depth.sensor import DepthSensor
from lab.drawing.renderer import DepthView
from people4d.messages import F32, F64, U16, CameraInfo
from scripts.render_people.outfits import Rng

STEREO, TIME_OF_FLIGHT = 0.45, 0.2  # shares of sensors; the others have structured light
EDGE_M = 0.1  # minimum step of depth at an edge [m]
LOST = 0.12  # share of images with blocks without reading, as in sunlight


def measure(rng: Rng, view: DepthView, info: CameraInfo) -> U16:
    """Return the readings of a random depth sensor [mm], HxW, 0: none."""
    seed = int(rng.integers(2**31))
    kind = rng.random()
    if kind > 1 - TIME_OF_FLIGHT:
        true_m = np.where(np.isfinite(view.depth_m), view.depth_m, 0).astype(np.float32)
        depth_m = time_of_flight(rng, true_m)
        depth_mm = np.where(depth_m > 0.2, np.clip(depth_m * 1000, 0, 65000), 0).astype(np.uint16)
    else:
        sensor = draw_sensor(rng, "d435i" if kind < STEREO else "xtion", info, seed)
        depth_mm = sensor.measure(view.depth_m.astype(np.float32), view.right_depth_m, 0.0)
    return with_lost_blocks(rng, depth_mm) if rng.random() < LOST else depth_mm


def draw_sensor(rng: Rng, name: SensorName, info: CameraInfo, seed: int) -> DepthSensor:
    """Draw a sensor with other errors than a usual one, scaled to the small images."""
    usual = SENSORS[name]
    changed = msgspec.structs.replace(
        usual,
        noise_px=usual.noise_px * float(np.exp(rng.normal(0, 0.5))),
        holes=float(min(0.3, usual.holes * np.exp(rng.normal(0.5, 1)))),
        scale_bias=float(rng.normal(0, 0.01)),
        shift_px=(float(rng.normal(0, 1.2)), float(rng.normal(0, 1.2))),
        max_depth_m=float(rng.uniform(4.5, 9)),
        signal_least=0.0,
        ragged_px=usual.ragged_px * 0.6,
        ragged_cell_px=max(2, usual.ragged_cell_px // 2),
        grain_px=max(2, usual.grain_px // 2),
        patch_px=usual.patch_px // 2,
        hole_px=4,
        focal_px=info.fx * 1.5,
    )
    return DepthSensor(changed, info, seed)


def time_of_flight(rng: Rng, depth_m: F32) -> F64:
    """Return depths with noise relative to depth, flying pixels at edges and a limited range."""
    white = rng.normal(0, 0.004, depth_m.shape) * (0.5 + depth_m)
    coarse = cv2.GaussianBlur(rng.normal(0, 1, depth_m.shape).astype(np.float32), (0, 0), 4)
    read_m = depth_m + white + coarse * 0.03
    square = np.ones((3, 3), np.uint8)
    far_m, near_m = cv2.dilate(depth_m, square), cv2.erode(depth_m, square)
    edge = far_m - near_m > EDGE_M
    flying_m = near_m + rng.random(depth_m.shape) * (np.minimum(far_m, 20) - near_m)
    read_m = np.where(edge & (rng.random(depth_m.shape) < 0.5), flying_m, read_m)
    read_m[edge & (rng.random(depth_m.shape) < 0.3)] = 0
    read_m[depth_m > rng.uniform(5, 9)] = 0
    return read_m


def with_lost_blocks(rng: Rng, depth_mm: U16) -> U16:
    """Return a depth image without the readings of some blocks."""
    side = int(rng.integers(3, 12))
    height, width = depth_mm.shape
    lost = rng.random((height // side + 1, width // side + 1)) < rng.uniform(0.03, 0.35)
    pixels = lost.repeat(side, 0).repeat(side, 1)[:height, :width]
    return np.where(pixels, 0, depth_mm).astype(np.uint16)
