"""Mesh of a body in the depth image: vertices, edges, normals (docs/method.md, section 8.2)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from common.geometry.transforms import deproject
from people4d.messages import F32, F64, CameraInfo
from services.gait.surface.bridges import bridge_pieces
from services.gait.surface.segmentation import (
    DEPTH_STEPS,
    I32,
    I64,
    JOIN_M,
    JOIN_PX,
    BodySegment,
    Mask,
)

# Neighbours in the grid, clockwise from the right: row and column.
NEIGHBOURS = np.array(
    [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)], dtype=np.int32
)
VERTICES = 3000  # Approximate maximum number of vertices of a mesh; published: one for each pixel
# Length of an edge: minimum [m], published; factor of the spacing of a surface at right angles to
# the ray; noise of vertices by the distance squared [m/m^2]
EDGE_M, EDGE_STRETCH, EDGE_NOISE_PER_M2 = 0.015, 2.0, 0.003
# Distance about a vertex within which depth is averaged [px]: the residual noise of a stereo camera
# is longer than the edges and would lengthen all paths along the surface; published: 0
SMOOTH_PX = 6


@dataclass(frozen=True, kw_only=True)
class BodyMesh:
    """Mesh of one body; V vertices."""

    points_m: F64  # Vx3, optical frame
    pixels_px: F64  # Vx2, u and v in the image
    indptr: I32  # V + 1: the neighbours of vertex i are indices[indptr[i] : indptr[i + 1]]
    indices: I32  # E
    lengths_m: F64  # E, lengths of the edges
    neighbours: I32  # Vx8, in the order of NEIGHBOURS; -1: no edge
    grid: I32  # rows x columns of the vertices, -1 off the body
    left_px: int  # [px] left edge of the grid in the image
    top_px: int
    step_px: int  # [px] distance between vertices

    @cached_property
    def middle_m(self) -> F64:
        """Median of the points, 3."""
        return np.asarray(np.median(self.points_m, axis=0))

    @cached_property
    def normals(self) -> F64:
        """Normals, Vx3, unit length, towards the sensor.

        Means over the faces of a vertex, weighted by their angles [Thürmer 1998].
        """
        known = self.neighbours >= 0
        edges = self.points_m[self.neighbours] - self.points_m[:, None]
        others = np.roll(edges, -1, axis=1)
        faces = np.cross(edges, others)
        areas = np.linalg.norm(faces, axis=2)
        angles = np.arctan2(areas, (edges * others).sum(axis=2))
        weights = angles * (known & np.roll(known, -1, axis=1)) / np.maximum(areas, 1e-12)
        normals = (weights[..., None] * faces).sum(axis=1)
        lone = np.linalg.norm(normals, axis=1) < 1e-9  # no face
        normals[lone] = -self.points_m[lone]
        normals[(normals * self.points_m).sum(axis=1) > 0] *= -1
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))

    def vertices_at(self, pixels_px: npt.ArrayLike) -> I64:
        """Return the vertices (M) at pixels (Mx2: u, v); -1 off the body."""
        pixels = np.asarray(pixels_px, np.float64).reshape(-1, 2)
        # A pixel extends half a pixel to each side of its coordinates.
        cell = np.floor((pixels + 0.5 - (self.left_px, self.top_px)) / self.step_px)
        rows, columns = self.grid.shape
        with np.errstate(invalid="ignore"):
            inside = ((cell >= 0) & (cell < (columns, rows))).all(axis=1)
        found = np.full(len(pixels), -1, np.int64)
        column, row = cell[inside].astype(np.int64).T
        found[inside] = self.grid[row, column]
        return found

    def nearest(self, point_m: npt.ArrayLike) -> int:
        """Return the vertex nearest to a point, 3, optical frame; -1 if the mesh is empty."""
        if not len(self.points_m):
            return -1
        offsets = self.points_m - np.asarray(point_m, np.float64)
        return int(np.argmin(np.einsum("ij,ij->i", offsets, offsets)))


def build_mesh(body: BodySegment, info: CameraInfo) -> BodyMesh:
    """Build the mesh of a body.

    Source: docs/method.md, section 8.2 (G 4.1.4).
    """
    step = _step_px(body)
    rows, columns = -(-body.mask.shape[0] // step), -(-body.mask.shape[1] // step)
    grid = np.full((rows, columns), -1, np.int32)
    samples = np.empty((rows * columns, 3))
    count = _sample(body.depth_m, body.mask, step, DEPTH_STEPS, grid, samples)
    samples = samples[:count]
    _smooth_depth(body.depth_m, SMOOTH_PX, DEPTH_STEPS, samples)
    pixels = samples[:, :2] + (body.left_px, body.top_px)
    points = deproject(pixels, samples[:, 2], info)
    limits = _edge_limits_m(samples[:, 2], step, info)
    near, long_m = np.full((count, 8), -1, np.int32), np.empty((count, 8))
    _connect(grid, points, limits, NEIGHBOURS, near, long_m)
    linked = near >= 0
    indptr = np.concatenate([[0], np.cumsum(linked.sum(axis=1))]).astype(np.int32)
    indices, lengths = near[linked], long_m[linked]
    cells = max(-(-JOIN_PX // step), 1)
    indptr, indices, lengths = bridge_pieces(
        grid, points, (indptr, indices, lengths), cells, JOIN_M
    )
    return BodyMesh(
        points_m=points,
        pixels_px=pixels,
        indptr=indptr,
        indices=indices,
        lengths_m=lengths,
        neighbours=near,
        grid=grid,
        left_px=body.left_px,
        top_px=body.top_px,
        step_px=step,
    )


def _step_px(body: BodySegment) -> int:
    """Return the spacing of vertices, which bounds their number for any size of a person."""
    return max(1, round((np.count_nonzero(body.mask) / VERTICES) ** 0.5))


def _edge_limits_m(depth_m: F64, step_px: int, info: CameraInfo) -> F64:
    """Return the maximum length of edges at vertices, V, by their depth, V."""
    diagonal_m = depth_m * (step_px * 2**0.5 / min(info.fx, info.fy))
    noise_m = EDGE_NOISE_PER_M2 * depth_m**2
    return np.maximum(EDGE_M, np.hypot(EDGE_STRETCH * diagonal_m, noise_m))


@compiled
def _sample(
    depth_m: F32,
    mask: Mask,
    step: int,
    depth_steps: tuple[float, float, float],
    grid: I32,
    samples: F64,
) -> int:
    """Set a vertex for each step x step pixels: the mean pixel of the nearest surface."""
    height, width = depth_m.shape
    count = 0
    for row in range(grid.shape[0]):
        for column in range(grid.shape[1]):
            nearest = np.inf
            for r in range(row * step, min((row + 1) * step, height)):
                for c in range(column * step, min((column + 1) * step, width)):
                    if mask[r, c] and depth_m[r, c] < nearest:
                        nearest = depth_m[r, c]
            if nearest == np.inf:
                continue
            grown = depth_steps[1] * nearest + depth_steps[2] * nearest * nearest
            farthest = nearest + step * max(depth_steps[0], grown)
            u = v = z = 0.0
            number = 0
            for r in range(row * step, min((row + 1) * step, height)):
                for c in range(column * step, min((column + 1) * step, width)):
                    if mask[r, c] and depth_m[r, c] <= farthest:
                        u += c
                        v += r
                        z += depth_m[r, c]
                        number += 1
            grid[row, column] = count
            samples[count, 0], samples[count, 1] = u / number, v / number
            samples[count, 2] = z / number
            count += 1
    return count


@compiled
def _smooth_depth(
    depth_m: F32, radius: int, depth_steps: tuple[float, float, float], samples: F64
) -> None:
    """Set the depth of vertices to the mean of the pixels about them on the same surface."""
    height, width = depth_m.shape
    for k in range(len(samples)):
        column, row, here = int(samples[k, 0] + 0.5), int(samples[k, 1] + 0.5), samples[k, 2]
        limit = max(depth_steps[0], depth_steps[1] * here + depth_steps[2] * here * here)
        total, number = 0.0, 0
        # The window is symmetric: a one-sided mean would bend the rims. Every other pixel suffices,
        # since neighbouring pixels of a stereo camera have correlated noise.
        across = min(radius, column, width - 1 - column)
        down = min(radius, row, height - 1 - row)
        for r in range(row - down, row + down + 1, 2):
            for c in range(column - across, column + across + 1, 2):
                value = depth_m[r, c]
                if value > 0 and abs(value - here) < limit:
                    total += value
                    number += 1
        if number > 0:
            samples[k, 2] = total / number


@compiled
def _connect(grid: I32, points: F64, limits: F64, neighbours: I32, near: I32, long: F64) -> None:
    """Set the neighbours of vertices, in the order of NEIGHBOURS, and their distances."""
    rows, columns = grid.shape
    for row in range(rows):
        for column in range(columns):
            here = grid[row, column]
            if here < 0:
                continue
            for k in range(4):  # the other four neighbours have the same edges
                r, c = row + neighbours[k, 0], column + neighbours[k, 1]
                if r < 0 or r >= rows or c < 0 or c >= columns or grid[r, c] < 0:
                    continue
                there = grid[r, c]
                x = points[there, 0] - points[here, 0]
                y = points[there, 1] - points[here, 1]
                z = points[there, 2] - points[here, 2]
                length = np.sqrt(x * x + y * y + z * z)
                if length <= min(limits[here], limits[there]):
                    near[here, k], near[there, k + 4] = there, here
                    long[here, k] = long[there, k + 4] = length
