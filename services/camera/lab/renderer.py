"""Images of the virtual lab: depth with the owner of each pixel."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.messages import F32, F64, CameraInfo
from services.camera.lab.mesh import Mesh, join
from services.camera.lab.raster import Raster, homogeneous_pixels, rasterise
from services.camera.lab.views import DepthView


@dataclass(frozen=True)
class Extent:
    """How much of the image a body would cover if nothing hid it.

    Args:
        pixels: Number of pixels inside the image.
        box_xyxy_px: 4, just around them, right and lower edge exclusive; NaN if there are none.
    """

    pixels: int
    box_xyxy_px: F64


def draw_depth(
    meshes: Sequence[Mesh],
    optical_from_map: F64,
    info: CameraInfo,
    baseline_m: float,
    threads: int = 1,
) -> DepthView:
    """Draw depth and owners as a perfect pair of imagers sees them.

    Args:
        meshes: All that is seen, the room included; none: the depth is inf everywhere.
        optical_from_map: 4x4 of the left imager.
        info: Calibration of both imagers.
        baseline_m: How far to the right the right imager is.
        threads: Number of threads; the result does not depend on it.
    """
    size = (info.height, info.width)
    if not meshes:
        empty: F32 = np.full(size, np.inf, np.float32)
        return DepthView(empty, np.zeros(size, np.uint8), empty.copy())
    scene = join(meshes)
    corners = homogeneous_pixels(scene.vertices_m, optical_from_map, info)
    left = rasterise(corners, scene.faces, size, threads)
    corners[:, 0] -= info.fx * baseline_m
    right = rasterise(corners, scene.faces, size, threads)
    owners = np.append(scene.owner, 0).astype(np.uint8)[left.triangle]
    return DepthView(left.depth_m(), owners, right.depth_m())


def draw_alone(mesh: Mesh, optical_from_map: F64, info: CameraInfo) -> Raster:
    """Draw one mesh as if there were nothing else."""
    corners = homogeneous_pixels(mesh.vertices_m, optical_from_map, info)
    return rasterise(corners, mesh.faces, (info.height, info.width))


def body_extents(mesh: Mesh, optical_from_map: F64, info: CameraInfo) -> Extent:
    """Return how much of the image a body would cover if nothing hid it."""
    seen = draw_alone(mesh, optical_from_map, info).triangle >= 0
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if not len(rows):
        return Extent(0, np.full(4, np.nan))
    box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], np.float64)
    return Extent(int(seen.sum()), box)
