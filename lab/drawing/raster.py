"""Rasteriser: the nearest triangle at each pixel, and its depth.

A point of the optical frame is q = (fx x + cx z, fy y + cy z, z), so the pixel (u, v) sees the
points z (u, v, 1) = q. For a triangle with corners q0, q1, q2 the numbers

    e = [q0 q1 q2]^-1 (u, v, 1)

are all positive at pixels inside the triangle; their sum is 1 / z, and e z are the barycentric
coordinates with perspective. e is linear in u and v, without division by the z of a corner, so
triangles that reach behind the camera need no clipping but only a correct bounding box
[Olano 1997].
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TypeVar

import numpy as np

from common.compiled import compiled
from lab.drawing.mesh import I32
from people4d.messages import F32, F64

NEAR_M = 0.05  # minimum depth of a visible surface [m]
T = TypeVar("T")


@dataclass(frozen=True)
class Raster:
    """Nearest face and inverse depth of each pixel."""

    inverse_depth: F32  # [1/m] HxW, along the optical axis; 0: no surface
    triangle: I32  # HxW index of the face; -1: no surface

    def depth_m(self) -> F32:
        """Return HxW depth; inf: no surface."""
        with np.errstate(divide="ignore"):
            return np.float32(1.0) / self.inverse_depth


def homogeneous(points_m: F64, pixels_from_points: F64) -> F64:
    """Return the corners q of triangles, Nx3 (u z, v z, z), from a 3x4 projection of points."""
    matrix = pixels_from_points
    return np.ascontiguousarray(points_m @ matrix[:, :3].T + matrix[:, 3])


def rasterise(
    corners: F64, faces: I32, size: tuple[int, int], threads: int = 1, limit: F32 | None = None
) -> Raster:
    """Draw both sides of triangles; the first of equally near faces wins.

    Args:
        corners: Vx3, see `homogeneous`; the centres of pixels are integers.
        faces: Fx3 indices of corners.
        size: Height and width of the image.
        threads: Number of threads.
        limit: Maximum inverse depth of visible surfaces, HxW [1/m]; None: at NEAR_M.
    """
    most = np.full(size, 1.0 / NEAR_M, np.float32) if limit is None else limit
    inverse_depth = np.zeros(size, np.float32)
    triangle = np.full(size, -1, np.int32)
    in_bands(
        lambda first, last: _draw(corners, faces, most, first, last, inverse_depth, triangle),
        size[0],
        threads,
    )
    return Raster(inverse_depth, triangle)


@compiled
def barycentrics(corners: F64, i: int, j: int, k: int, u: float, v: float) -> tuple[float, float]:
    """Return the weights of corners j and k of face (i, j, k) at pixel (u, v)."""
    a0, a1, a2 = corners[i, 0], corners[i, 1], corners[i, 2]
    b0, b1, b2 = corners[j, 0], corners[j, 1], corners[j, 2]
    c0, c1, c2 = corners[k, 0], corners[k, 1], corners[k, 2]
    wa = (b1 * c2 - b2 * c1) * u + ((b2 * c0 - b0 * c2) * v + (b0 * c1 - b1 * c0))
    wb = (c1 * a2 - c2 * a1) * u + ((c2 * a0 - c0 * a2) * v + (c0 * a1 - c1 * a0))
    wc = (a1 * b2 - a2 * b1) * u + ((a2 * b0 - a0 * b2) * v + (a0 * b1 - a1 * b0))
    scale = 1.0 / (wa + wb + wc)
    return wb * scale, wc * scale


@compiled
def _draw(
    corners: F64,
    faces: I32,
    limit: F32,
    first: int,
    last: int,
    inverse_depth: F32,
    triangle: I32,
) -> None:
    """Draw all faces into the rows from `first` to `last`, exclusive."""
    width = inverse_depth.shape[1]
    us = np.empty(len(corners))
    vs = np.empty(len(corners))
    for i in range(len(corners)):
        if corners[i, 2] > NEAR_M:
            us[i] = corners[i, 0] / corners[i, 2]
            vs[i] = corners[i, 1] / corners[i, 2]
    for t in range(len(faces)):
        a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
        a2, b2, c2 = corners[a, 2], corners[b, 2], corners[c, 2]
        if a2 > NEAR_M and b2 > NEAR_M and c2 > NEAR_M:
            v_min, v_max = min(vs[a], vs[b], vs[c]), max(vs[a], vs[b], vs[c])
            if v_max < first or v_min > last - 1:
                continue
            u_min, u_max = min(us[a], us[b], us[c]), max(us[a], us[b], us[c])
        else:
            u_min, u_max, v_min, v_max = _bounds(corners, faces[t])
        if not (v_max >= first and v_min <= last - 1 and u_max >= 0 and u_min <= width - 1):
            continue
        top, bottom = math.ceil(max(v_min, first)), math.floor(min(v_max, last - 1))
        left, right = math.ceil(max(u_min, 0)), math.floor(min(u_max, width - 1))
        if top > bottom or left > right:
            continue
        a0, a1, b0, b1 = corners[a, 0], corners[a, 1], corners[b, 0], corners[b, 1]
        c0, c1 = corners[c, 0], corners[c, 1]
        # Neighbours compute a common edge from the same products, without gaps between them.
        ax, ay, ak = b1 * c2 - b2 * c1, b2 * c0 - b0 * c2, b0 * c1 - b1 * c0
        bx, by, bk = c1 * a2 - c2 * a1, c2 * a0 - c0 * a2, c0 * a1 - c1 * a0
        cx, cy, ck = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
        volume = a0 * ax + a1 * ay + a2 * ak
        if volume == 0.0:
            continue
        if volume < 0.0:
            ax, ay, ak, bx, by, bk = -ax, -ay, -ak, -bx, -by, -bk
            cx, cy, ck, volume = -cx, -cy, -ck, -volume
        scale = 1.0 / volume
        for v in range(top, bottom + 1):
            a_row, b_row, c_row = ay * v + ak, by * v + bk, cy * v + ck
            start, end = left, right
            if right - left > 8:
                start, end = _span(ax, a_row, start, end)
                start, end = _span(bx, b_row, start, end)
                start, end = _span(cx, c_row, start, end)
            for u in range(start, end + 1):
                wa, wb, wc = ax * u + a_row, bx * u + b_row, cx * u + c_row
                if wa >= 0.0 and wb >= 0.0 and wc >= 0.0:
                    inverse = np.float32((wa + wb + wc) * scale)
                    if inverse_depth[v, u] < inverse < limit[v, u]:
                        inverse_depth[v, u] = inverse
                        triangle[v, u] = t


@compiled
def _span(slope: float, offset: float, start: int, end: int) -> tuple[int, int]:
    """Narrow a row to slope u + offset >= 0, with a margin of a pixel for rounding."""
    if slope == 0.0:
        return start, (end if offset >= 0.0 else start - 1)
    zero = min(max(-offset / slope, start - 1.0), end + 1.0)
    if slope > 0.0:
        return max(start, math.floor(zero)), end
    return start, min(end, math.ceil(zero))


@compiled
def _bounds(corners: F64, face: I32) -> tuple[float, float, float, float]:
    """Return the minimum and maximum u and v of the part of a face beyond the near plane."""
    u_min, u_max, v_min, v_max = np.inf, -np.inf, np.inf, -np.inf
    for i in range(3):
        p, q = corners[face[i]], corners[face[(i + 1) % 3]]
        u, v = np.nan, np.nan
        if p[2] > NEAR_M:
            u, v = p[0] / p[2], p[1] / p[2]
            u_min, u_max, v_min, v_max = min(u_min, u), max(u_max, u), min(v_min, v), max(v_max, v)
        if (p[2] > NEAR_M) != (q[2] > NEAR_M):
            share = (NEAR_M - p[2]) / (q[2] - p[2])
            u = (p[0] + share * (q[0] - p[0])) / NEAR_M
            v = (p[1] + share * (q[1] - p[1])) / NEAR_M
            u_min, u_max, v_min, v_max = min(u_min, u), max(u_max, u), min(v_min, v), max(v_max, v)
    return u_min, u_max, v_min, v_max


def at_once(jobs: Sequence[Callable[[], T]], threads: int) -> list[T]:
    """Return the results of independent jobs in order."""
    if threads <= 1:
        return [job() for job in jobs]
    with ThreadPoolExecutor(threads) as pool:
        started = [pool.submit(job) for job in jobs]
        return [job.result() for job in started]


def in_bands(work: Callable[[int, int], object], rows: int, threads: int) -> None:
    """Call `work(first, last)` for bands that together cover all rows, last exclusive.

    Each pixel depends on its own row only, so the result does not depend on the number of bands.
    """
    bands = max(threads, 1)
    edges = [rows * band // bands for band in range(bands + 1)]
    at_once([partial(work, first, last) for first, last in pairwise(edges)], threads)
