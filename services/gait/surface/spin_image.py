"""Spin images: what the surface about a point looks like, whichever way the body is turned."""

import math
from functools import lru_cache
from typing import TypeAlias

import msgspec
import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from people4d.messages import F32, F64
from services.gait.surface.mesh import Surface

NO_MATCH = -math.inf
R_MAX = 1 - 1e-6  # atanh of 1 is infinite
FILLED = 1e-3  # points in a bin; less is what rounding leaves to a neighbouring bin
I64: TypeAlias = npt.NDArray[np.int64]


class SpinConfig(msgspec.Struct, frozen=True, kw_only=True):
    """How spin images are made and compared (method book section 8.3)."""

    bins: int = 20  # across and down; section 8.3
    # [m] of a bin. The paper takes 1 to 2 times the mesh's resolution, but that changes with the
    # distance, and images are compared over time; 0: bin_resolutions times the resolution
    bin_m: float = 0.02
    bin_resolutions: float = 1.5  # where bin_m is 0
    support_angle_deg: float = 75.0  # [deg] between normals of what is counted; 60 to 90
    points: int = 1000  # of the surface that are counted, at most about; 0: all
    overlap_min: int = 10  # bins that both images fill; fewer: no match

    def __post_init__(self) -> None:
        """Check numbers.

        Raises:
            ValueError: One is out of range.
        """
        if not 2 <= self.bins <= 128:
            raise ValueError(f"bins: expected 2 to 128, got {self.bins}")
        if not 0 <= self.bin_m < math.inf or not 0 < self.bin_resolutions < math.inf:
            raise ValueError(
                f"bin_m, bin_resolutions: expected >= 0, got {self.bin_m}, {self.bin_resolutions}"
            )
        if not 0 < self.support_angle_deg <= 180:
            raise ValueError(f"support_angle_deg: expected 0 to 180, got {self.support_angle_deg}")
        if self.points < 0 or self.overlap_min < 4:
            raise ValueError(
                f"points: expected >= 0, overlap_min: >= 4, got {self.points}, {self.overlap_min}"
            )


def spin_images(surface: Surface, vertices: npt.ArrayLike, config: SpinConfig) -> F64:
    """Return the spin images of vertices.

    Rows are beta, the height above the plane of the vertex, from -bins/2 to bins/2; columns are
    alpha, the distance from its normal. Bins are counted bilinearly.

    Args:
        surface: The mesh.
        vertices: M.
        config: Size of the images.

    Returns:
        M x bins x bins; all 0 for a vertex that is not on the surface.

    Source: method book section 8.3 [G 4.2.1].
    """
    chosen = np.atleast_1d(np.asarray(vertices, np.int64))
    images = np.zeros((len(chosen), config.bins, config.bins))
    count = len(surface.points_m)
    bin_m = config.bin_m or config.bin_resolutions * surface.resolution_m
    if count == 0 or bin_m <= 0:
        return images
    kept = _sample(count, config.points)
    # Single precision is twice as fast, and exact enough from the body's middle.
    middle = surface.points_m.mean(axis=0)
    points = ((surface.points_m[kept] - middle) / bin_m).T.astype(np.float32, order="C")
    normals = surface.normals[kept].T.astype(np.float32, order="C")
    valid = np.flatnonzero((chosen >= 0) & (chosen < count))
    at = ((surface.points_m[chosen[valid]] - middle) / bin_m).astype(np.float32)
    facing = surface.normals[chosen[valid]].astype(np.float32)
    cosine = math.cos(math.radians(config.support_angle_deg))
    _spin(at, facing, valid, points, normals, cosine, images)
    return images


@lru_cache(maxsize=16)
def _sample(count: int, wanted: int) -> I64:
    """Return which of the points are counted."""
    # A fixed stride through the rows would take whole columns; chance takes them evenly.
    kept = np.random.default_rng(0).permutation(count)
    return np.sort(kept[:wanted]) if wanted else np.arange(count)


@compiled
def _spin(
    at: F32, facing: F32, rows: I64, points: F32, normals: F32, cosine: float, images: F64
) -> None:
    """Fill images; lengths are in bins, points and normals in columns."""
    bins = images.shape[1]
    half = np.float32(bins / 2)
    count = points.shape[1]
    alphas, betas = np.empty(count, np.float32), np.empty(count, np.float32)
    least = np.float32(cosine)
    for m in range(len(at)):
        px, py, pz = at[m, 0], at[m, 1], at[m, 2]
        nx, ny, nz = facing[m, 0], facing[m, 1], facing[m, 2]
        # A loop without branches, which the compiler does for many points at once.
        for k in range(count):
            dx, dy, dz = points[0, k] - px, points[1, k] - py, points[2, k] - pz
            beta = nx * dx + ny * dy + nz * dz
            square = dx * dx + dy * dy + dz * dz - beta * beta
            alpha = np.sqrt(max(square, np.float32(0)))
            like = nx * normals[0, k] + ny * normals[1, k] + nz * normals[2, k]
            alphas[k] = alpha if like >= least else np.float32(bins)
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


def similarity(images: F64, reference: F64, overlap_min: int = 10) -> F64:
    """Return how like a reference images are, by the bins that both fill.

    C = atanh(R)^2 - lambda / (N - 3): R is the correlation of the N bins, lambda half of the
    median number of bins that the images fill. Images that are unlike (R < 0) get -atanh(R)^2.

    Args:
        images: M x W x W.
        reference: W x W.
        overlap_min: Bins that both must fill.

    Returns:
        M, -inf where there is no match.

    Source: method book section 8.3 [G 4.2.2].
    """
    flat, other = images.reshape(len(images), reference.size), reference.ravel()
    n, r = np.zeros(len(flat)), np.zeros(len(flat))
    filled = np.zeros(len(flat), np.int64)
    _correlate(flat, other, n, r, filled)
    found = np.full(len(flat), NO_MATCH)
    enough = n >= max(overlap_min, 4)
    if enough.any():
        z = np.arctanh(np.clip(r[enough], -R_MAX, R_MAX))
        half_filled = 0.5 * float(np.median(filled))
        found[enough] = np.sign(z) * z**2 - half_filled / (n[enough] - 3)
    return found


@compiled
def _correlate(images: F64, reference: F64, n: F64, r: F64, filled: I64) -> None:
    """Set how many bins both fill, their correlation, and how many bins each image fills."""
    shared = np.flatnonzero(reference > FILLED)
    others = reference[shared]
    if len(shared):
        others = others - others.mean()  # keeps the sums below exact
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
        if own > 1e-12 * aa and their > 1e-12 * bb:  # else one is the same everywhere
            r[m] = (ab - a * b / number) / np.sqrt(own * their)
