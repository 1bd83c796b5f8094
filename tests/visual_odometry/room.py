"""Room with patterned walls, rendered by ray casting for any pose of the camera."""

from dataclasses import dataclass

import cv2
import numpy as np

from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from people4d.messages import F32, F64, U8, U16
from services.visual_odometry.corners import OdometryFrame
from tests import builders

WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
INFO = builders.camera_info(
    width=WIDTH, height=HEIGHT, fx=FOCAL, cx=(WIDTH - 1) / 2, cy=(HEIGHT - 1) / 2
)
LOW, HIGH = np.array([-3.0, -3.0, 0.0]), np.array([4.0, 3.0, 2.5])  # [m] of the room
BASE_FROM_OPTICAL = (
    transform_from((0.1, 0.0, 1.0), rotation_from_rpy(0.0, 0.1, 0.0)) @ LINK_FROM_OPTICAL
)
PER_M = 40  # texels in 1 m
FRAME_NS = 66_666_667


@dataclass(frozen=True)
class Board:
    """Patterned board from floor to ceiling, across the x axis of the map.

    Args:
        x_m: Distance along x.
        y_m: Centre.
        half_m: Half the width.
    """

    x_m: float
    y_m: float
    half_m: float


def pattern(seed: int, contrast: float = 60.0) -> F32:
    noise = np.random.default_rng(seed).normal(0, 1, (400, 400)).astype(np.float32)
    soft = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return np.asarray(128 + contrast * soft / soft.std(), np.float32)


WALLS = [pattern(seed) for seed in range(6)]
CLOTH = pattern(9)


def base(x_m: float = 0.0, y_m: float = 0.0, theta_rad: float = 0.0) -> F64:
    return transform_from((x_m, y_m, 0.0), rotation_from_rpy(0.0, 0.0, theta_rad))


def view(
    map_from_base: F64,
    number: int = 0,
    boards: tuple[Board, ...] = (),
    noise_seed: int | None = None,
) -> OdometryFrame:
    """Render the image of the camera; a seed adds noise of two grey levels."""
    pose = map_from_base @ BASE_FROM_OPTICAL
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    rays = np.stack([(u - INFO.cx) / FOCAL, (v - INFO.cy) / FOCAL, np.ones_like(u)], axis=-1)
    rays_map, origin = rays @ pose[:3, :3].T, pose[:3, 3]
    with np.errstate(divide="ignore"):
        reach = np.where(rays_map > 0, HIGH - origin, LOW - origin) / rays_map
    depth, axis = reach.min(axis=-1), reach.argmin(axis=-1)
    grey = np.zeros((HEIGHT, WIDTH), np.float32)
    hit = origin + depth[..., None] * rays_map
    for wall in range(6):
        on = (axis == wall // 2) & (
            (np.take_along_axis(rays_map, axis[..., None], -1)[..., 0] > 0) == wall % 2
        )
        across = [hit[..., k] for k in range(3) if k != wall // 2]
        grey[on] = _texture(WALLS[wall], across[0] + 3.0, across[1] + 3.0)[on]
    for board in boards:
        far = (board.x_m - origin[0]) / rays_map[..., 0]
        aside = origin[1] + far * rays_map[..., 1] - board.y_m
        on = (far > 0) & (far < depth) & (np.abs(aside) < board.half_m)
        up = origin[2] + far * rays_map[..., 2]
        grey[on] = _texture(CLOTH, aside + 3.0, up + 3.0)[on]
        depth[on] = far[on]
    if noise_seed is not None:
        grey += np.random.default_rng(noise_seed).normal(0, 2, grey.shape).astype(np.float32)
    return as_view(grey.clip(0, 255).astype(np.uint8), depth, number)


def as_view(grey: U8, depth_m: F64, number: int = 0) -> OdometryFrame:
    rgb = np.repeat(grey[..., None], 3, axis=2)
    depth_mm: U16 = np.rint(1000 * depth_m).astype(np.uint16)
    return OdometryFrame(number * FRAME_NS, rgb, depth_mm)


def _texture(texture: F32, x_m: F64, y_m: F64) -> F32:
    x, y = (np.clip(m * PER_M, 0, 398).astype(np.float32) for m in (x_m, y_m))
    return np.asarray(cv2.remap(texture, x, y, cv2.INTER_LINEAR), np.float32)
