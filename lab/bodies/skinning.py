"""Skinning: vertices that move with bones; compiled inner loops."""

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from lab.drawing.mesh import I32
from people4d.messages import F64

INFLUENCES = 4


def strongest(weights: F64) -> tuple[I32, F64]:
    """Return the strongest bones of each vertex, and their shares with a sum of 1."""
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    shares = np.take_along_axis(weights, bones, axis=1)
    return bones.astype(np.int32), np.ascontiguousarray(shares / shares.sum(axis=1, keepdims=True))


def skin(vertices: F64, bones: I32, shares: F64, transforms: F64) -> F64:
    """Return moved vertices by linear blending.

    Args:
        vertices: Vx3 at rest.
        bones: VxK indices of bones.
        shares: VxK, rows sum to 1.
        transforms: Bx3x4 map_from_rest.
    """
    moved = np.empty_like(vertices)
    _skin(vertices, bones, shares, transforms, moved)
    return moved


def normals(vertices: F64, faces: I32) -> F64:
    """Return unit vertex normals: area-weighted means of the normals of triangles."""
    result = np.zeros_like(vertices)
    _normals(vertices, faces, result)
    return result


@compiled
def _skin(
    vertices: F64, bones: I32, shares: F64, transforms: F64, moved: npt.NDArray[np.float64]
) -> None:
    for v in range(len(vertices)):
        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        sx = sy = sz = 0.0
        for k in range(bones.shape[1]):
            share = shares[v, k]
            if share == 0.0:
                break  # the strongest bones are first
            m = transforms[bones[v, k]]
            sx += share * (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3])
            sy += share * (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3])
            sz += share * (m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3])
        moved[v, 0] = sx
        moved[v, 1] = sy
        moved[v, 2] = sz


@compiled
def _normals(vertices: F64, faces: I32, sums: F64) -> None:
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux = vertices[b, 0] - vertices[a, 0]
        uy = vertices[b, 1] - vertices[a, 1]
        uz = vertices[b, 2] - vertices[a, 2]
        wx = vertices[c, 0] - vertices[a, 0]
        wy = vertices[c, 1] - vertices[a, 1]
        wz = vertices[c, 2] - vertices[a, 2]
        nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
        for k in (a, b, c):
            sums[k, 0] += nx
            sums[k, 1] += ny
            sums[k, 2] += nz
    for v in range(len(sums)):
        length = np.sqrt(sums[v, 0] ** 2 + sums[v, 1] ** 2 + sums[v, 2] ** 2) + 1e-20
        sums[v, 0] /= length
        sums[v, 1] /= length
        sums[v, 2] /= length
