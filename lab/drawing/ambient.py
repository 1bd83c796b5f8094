"""Light of the walls, and the darkness of corners."""

import math

import numpy as np

from common.compiled import compiled
from lab.drawing.rooms import Room
from people4d.messages import F32, F64

DIRECTIONS: F64 = np.vstack([np.diag([-1.0] * 3), np.eye(3)])[[0, 3, 1, 4, 2, 5]]  # -x +x -y +y ...
PATCHES = 10  # number of patches along each edge of a wall
TERMS = 7  # number of terms of the polynomial 1 x y z x^2 y^2 z^2
REACH_M = 0.45  # maximum distance of surfaces that darken a corner [m]
PAIRS = 8  # number of pairs of readings around a pixel
COARSE = 2  # step of the pixels for which the darkness of corners is computed [px]


def bounce_light(room: Room) -> F64:
    """Return the light reflected by a room's walls.

    The walls are divided into patches, lit by the lights and by the mean light of all patches. The
    irradiance from all patches is computed at points in the room for six directions. Each direction
    is approximated by a polynomial of the position, which shading evaluates at every pixel.

    Returns:
        6x3xTERMS: direction (-x +x -y +y -z +z), colour, coefficient.
    """
    positions, inward, areas, albedo = _patches(room)
    lit = sum(
        (_from_light(room, index, positions, inward) for index in range(len(room.lights))), 0.0
    )
    mean_lit = np.average(lit * albedo, axis=0, weights=areas)
    mean_albedo = np.average(albedo, axis=0, weights=areas)
    sent = albedo * (lit + mean_lit / (1.0 - mean_albedo))
    shares = np.linspace(-0.85, 0.85, 5)
    probes = np.stack(np.meshgrid(shares, shares, shares, indexing="ij"), axis=-1).reshape(-1, 3)
    middle, half = (room.low_m + room.high_m) / 2, (room.high_m - room.low_m) / 2
    away = positions - (middle + probes * half)[:, None]
    squared = (away**2).sum(axis=-1)
    away /= np.sqrt(squared)[..., None]
    falling = np.maximum(-(away * inward).sum(axis=-1), 0.0) * areas / (math.pi * squared)
    design = np.column_stack([np.ones(len(probes)), probes, probes**2])
    result = np.empty((6, 3, TERMS))
    for index, direction in enumerate(DIRECTIONS):
        form = np.maximum(away @ direction, 0.0) * falling
        gathered = form @ sent / form.sum(axis=1, keepdims=True)
        result[index] = np.linalg.lstsq(design, gathered, rcond=None)[0].T
    return result


def direct_light(room: Room, position_m: F64, normal: F64) -> F64:
    """Return the irradiance (3) at a point from all lights, without shadows."""
    total = np.zeros(3)
    for index in range(len(room.lights)):
        total += _from_light(room, index, position_m[None], normal[None])[0]
    return total


def _from_light(room: Room, index: int, positions: F64, normals: F64) -> F64:
    light = room.lights[index]
    away = light.position_m - positions
    squared = (away**2).sum(axis=1)
    falling = np.maximum((away * normals).sum(axis=1), 0.0)
    emitted = np.maximum(-(away @ light.towards), 0.0)
    share: F64 = falling * emitted / (squared * (squared + light.radius_m**2))
    return share[:, None] * light.intensity


def _patches(room: Room) -> tuple[F64, F64, F64, F64]:
    """Return centre, inward normal, area and reflectance of the patches of all walls."""
    steps = (np.arange(PATCHES) + 0.5) / PATCHES
    size = room.high_m - room.low_m
    positions, inward, areas, albedo = [], [], [], []
    for wall, direction in enumerate(DIRECTIONS):
        axis = wall // 2
        first, second = (axis + 1) % 3, (axis + 2) % 3
        grid = np.zeros((PATCHES, PATCHES, 3))
        grid[..., axis] = wall % 2
        grid[..., first], grid[..., second] = steps[:, None], steps[None, :]
        count = PATCHES**2
        positions.append(room.low_m + grid.reshape(-1, 3) * size)
        inward.append(np.tile(-direction, (count, 1)))
        areas.append(np.full(count, size[first] * size[second] / count))
        albedo.append(np.tile(room.walls[wall], (count, 1)))
    return np.vstack(positions), np.vstack(inward), np.concatenate(areas), np.vstack(albedo)


# Offsets of the readings in a half disc; each is read on both sides of the pixel
_TURN = np.arange(PAIRS) * (math.pi * (3 - math.sqrt(5)))
PAIR_OFFSETS: F64 = np.sqrt((np.arange(PAIRS) + 0.6) / PAIRS)[:, None] * np.column_stack(
    [np.cos(_TURN), np.sin(_TURN)]
)


@compiled
def corner_light(
    inverse: F32, step: int, focal_px: float, first: int, last: int, result: F32
) -> None:
    """Compute the share of the walls' light that reaches each pixel, 0 to 1, from depth.

    A surface is hollow if the mean depth of two points on either side of a pixel is less than the
    depth of the pixel.

    Args:
        inverse: Inverse depth of the image [1/m].
        step: Pixels of the image per pixel of the result.
        focal_px: Focal length of the image.
        first: First row of the result.
        last: End of the rows, exclusive.
        result: Output.
    """
    height, width = inverse.shape
    for row in range(first, last):
        for column in range(result.shape[1]):
            v, u = row * step, column * step
            middle = inverse[v, u]
            if middle == 0.0:
                result[row, column] = 1.0
                continue
            depth = 1.0 / middle
            reach = min(focal_px * REACH_M * middle, 0.12 * width)
            turn = ((row & 3) * 4 + (column & 3) * 7) % 16 * (math.pi / 16)
            ca, sa = math.cos(turn) * reach, math.sin(turn) * reach
            hollow = 0.0
            for i in range(PAIRS):
                x, y = PAIR_OFFSETS[i, 0], PAIR_OFFSETS[i, 1]
                du, dv = int(ca * x - sa * y), int(sa * x + ca * y)
                if not (0 <= u - du < width and 0 <= u + du < width):
                    continue
                if not (0 <= v - dv < height and 0 <= v + dv < height):
                    continue
                one, other = inverse[v - dv, u - du], inverse[v + dv, u + du]
                # The inverse depth of a plane is linear in the image: no false darkness
                rise = (0.5 * (one + other) - middle) * depth * depth
                if 0.004 < rise < 1.5 * REACH_M:
                    hollow += min(1.0, rise * 14) * (1 - rise / (1.5 * REACH_M))
            result[row, column] = max(0.25, 1.0 - 1.0 * hollow / PAIRS)


@compiled
def smoothed(coarse: F32, inverse: F32, step: int, v: int, u: int) -> float:
    """Return the corner light at pixel (u, v) of the image, from coarse pixels of similar depth."""
    height, width = coarse.shape
    middle = inverse[v, u]
    total, weight = 0.0, 1e-6
    row, column = v // step, u // step
    for i in range(-1, 3):
        for j in range(-1, 3):
            y, x = row + i, column + j
            if 0 <= y < height and 0 <= x < width:
                off = abs(inverse[y * step, x * step] - middle)
                if off < 0.06 * middle:
                    total += coarse[y, x]
                    weight += 1.0
    return total / weight if weight > 0.5 else 1.0
