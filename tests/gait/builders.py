"""Bodies of known shape, and meshes of a few vertices."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from services.gait.surface.mesh import BodyMesh
from services.gait.surface.segmentation import BodySegment
from tests import builders

INFO = builders.camera_info(fx=500.0)


def body_of(depth_m: npt.ArrayLike, left_px: int = 0, top_px: int = 0) -> BodySegment:
    """A body of all pixels that have depth."""
    depth = np.asarray(depth_m, np.float32)
    return BodySegment(left_px=left_px, top_px=top_px, depth_m=depth, mask=depth > 0)


def mesh_of(points_m: npt.ArrayLike, edges: Sequence[tuple[int, int]]) -> BodyMesh:
    """A mesh of points and the edges between them, as INFO's camera would see it."""
    points = np.asarray(points_m, np.float64)
    both = sorted([*edges, *((end, start) for start, end in edges)])
    starts, ends = np.array(both, np.int32).reshape(-1, 2).T
    lengths = np.linalg.norm(points[ends] - points[starts], axis=1)
    pixels = points[:, :2] / points[:, 2:] * INFO.fx + (INFO.cx, INFO.cy)
    columns, rows = np.rint(pixels).astype(int).T
    grid = np.full((INFO.height, INFO.width), -1, np.int32)
    grid[rows, columns] = np.arange(len(points))
    return BodyMesh(
        points_m=points,
        pixels_px=pixels,
        indptr=np.searchsorted(starts, np.arange(len(points) + 1)).astype(np.int32),
        indices=ends.astype(np.int32),
        lengths_m=lengths,
        neighbours=np.full((len(points), 8), -1, np.int32),
        grid=grid,
        left_px=0,
        top_px=0,
        step_px=1,
    )
