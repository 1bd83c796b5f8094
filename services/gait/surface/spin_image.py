"""Spin images: rotation-invariant descriptors of the surface about a vertex.

Source: docs/method.md, section 8.3 [Johnson 1997] [Johnson 1999].
"""

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from people4d.messages import F32, F64
from services.gait.surface.mesh import BodyMesh
from services.gait.surface.segmentation import I64

BINS = 20  # Bins across and down; published
# Side of a bin [m]. Published: 1 to 2 times the mesh's resolution, which changes with the distance,
# while images are compared over time
BIN_M = 0.02
SUPPORT_ANGLE_DEG = 75.0  # Maximum angle between normals [deg]; published: 60 to 90
VERTICES_MAX = 1000  # Maximum number of counted vertices
OVERLAP_MIN = 10  # Minimum number of bins filled in both of two images that match
SIMILARITY_SIGMA = 1.5  # Standard deviation of the similarity
NO_MATCH = -math.inf
R_MAX = 1 - 1e-6  # Maximum correlation, because atanh(1) is infinite
FILLED = 1e-3  # Minimum count of a filled bin, above rounding errors of bilinear counting


def spin_images(mesh: BodyMesh, vertices: npt.ArrayLike) -> F64:
    """Return the spin images (M x bins x bins) of M vertices; all 0 for an invalid index.

    Rows are beta, the height above the plane of the vertex, from -bins/2 to bins/2; columns are
    alpha, the distance from its normal. Bins are counted bilinearly.

    Source: docs/method.md, section 8.3 (G 4.2.1).
    """
    chosen = np.atleast_1d(np.asarray(vertices, np.int64))
    images = np.zeros((len(chosen), BINS, BINS))
    count = len(mesh.points_m)
    if count == 0:
        return images
    sample = _sample(count, VERTICES_MAX)
    # Single precision is twice as fast, and exact enough relative to the body's middle.
    middle = mesh.points_m.mean(axis=0)
    points = ((mesh.points_m[sample] - middle) / BIN_M).T.astype(np.float32, order="C")
    normals = mesh.normals[sample].T.astype(np.float32, order="C")
    valid = np.flatnonzero((chosen >= 0) & (chosen < count))
    at = ((mesh.points_m[chosen[valid]] - middle) / BIN_M).astype(np.float32)
    axes = mesh.normals[chosen[valid]].astype(np.float32)
    cosine = math.cos(math.radians(SUPPORT_ANGLE_DEG))
    _spin(at, axes, valid, points, normals, cosine, images)
    return images


@lru_cache(maxsize=16)
def _sample(count: int, wanted: int) -> I64:
    """Return a random sample of the vertices."""
    # A fixed stride through the rows would take entire columns.
    order = np.random.default_rng(0).permutation(count)
    return np.sort(order[:wanted])


@compiled
def _spin(
    at: F32, axes: F32, rows: I64, points: F32, normals: F32, cosine: float, images: F64
) -> None:
    """Fill spin images; lengths are in bins, points and normals in columns."""
    bins = images.shape[1]
    half = np.float32(bins / 2)
    count = points.shape[1]
    alphas, betas = np.empty(count, np.float32), np.empty(count, np.float32)
    least = np.float32(cosine)
    for m in range(len(at)):
        px, py, pz = at[m, 0], at[m, 1], at[m, 2]
        nx, ny, nz = axes[m, 0], axes[m, 1], axes[m, 2]
        # The loop has no branches, so the compiler vectorises it.
        for k in range(count):
            dx, dy, dz = points[0, k] - px, points[1, k] - py, points[2, k] - pz
            beta = nx * dx + ny * dy + nz * dz
            square = dx * dx + dy * dy + dz * dz - beta * beta
            alpha = np.sqrt(max(square, np.float32(0)))
            cosine_k = nx * normals[0, k] + ny * normals[1, k] + nz * normals[2, k]
            alphas[k] = alpha if cosine_k >= least else np.float32(bins)
            betas[k] = beta + half
        image = images[rows[m]]
        for k in range(count):
            row, column = betas[k], alphas[k]
            if column >= bins or row < -1 or row >= bins:
                continue
            i, j = int(np.floor(row)), int(column)
            a, b = row - i, column - j
            if i >= 0:
                image[i, j] += (1 - a) * (1 - b)
                if j + 1 < bins:
                    image[i, j + 1] += (1 - a) * b
            if i + 1 < bins:
                image[i + 1, j] += a * (1 - b)
                if j + 1 < bins:
                    image[i + 1, j + 1] += a * b


def similarity(images: F64, reference: F64) -> F64:
    """Return the similarities (M) of images (MxWxW) to a reference, by the bins filled in both.

    C = atanh(R)^2 - lambda / (N - 3): R is the correlation of the N bins, lambda half of the
    median number of bins that the images fill. Negative correlation gives -atanh(R)^2; with fewer
    than OVERLAP_MIN bins there is no match, -inf.

    Source: docs/method.md, section 8.3 (G 4.2.2).
    """
    flat, other = images.reshape(len(images), reference.size), reference.ravel()
    n, r = np.zeros(len(flat)), np.zeros(len(flat))
    filled = np.zeros(len(flat), np.int64)
    _correlate(flat, other, n, r, filled)
    found = np.full(len(flat), NO_MATCH)
    enough = n >= OVERLAP_MIN
    if enough.any():
        z = np.arctanh(np.clip(r[enough], -R_MAX, R_MAX))
        half_filled = 0.5 * float(np.median(filled))
        found[enough] = np.sign(z) * z**2 - half_filled / (n[enough] - 3)
    return found


@compiled
def _correlate(images: F64, reference: F64, n: F64, r: F64, filled: I64) -> None:
    """Set the bins filled in both, their correlation, and the bins filled in each image."""
    shared = np.flatnonzero(reference > FILLED)
    others = reference[shared]
    if len(shared):
        others = others - others.mean()  # avoids cancellation in the sums below
    for m in range(len(images)):
        image = images[m]
        for value in image:
            filled[m] += value > FILLED
        number, a, b, aa, bb, ab = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(len(shared)):
            value = image[shared[k]]
            if value <= FILLED:
                continue
            number += 1
            other = others[k]
            a, aa = a + value, aa + value * value
            b, bb = b + other, bb + other * other
            ab += value * other
        n[m] = number
        if number == 0:
            continue
        own, their = aa - a * a / number, bb - b * b / number
        if own > 1e-12 * aa and their > 1e-12 * bb:  # otherwise one image is constant
            r[m] = (ab - a * b / number) / np.sqrt(own * their)
