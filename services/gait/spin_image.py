"""Spin images: what the surface about a point looks like, whichever way the body is turned."""

import math
from typing import TypeAlias

import msgspec
import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from common.messages import F64
from services.gait.surface import Surface

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
    # A fixed stride through the rows would take whole columns; chance takes them evenly.
    points, normals = surface.points_m, surface.normals
    if 0 < config.points < count:
        kept = np.random.default_rng(0).permutation(count)[: config.points]
        points, normals = points[kept], normals[kept]
    cosine = math.cos(math.radians(config.support_angle_deg))
    valid = (chosen >= 0) & (chosen < count)
    at = chosen[valid]
    made = np.zeros((len(at), config.bins, config.bins))
    _spin(surface.points_m[at], surface.normals[at], points, normals, bin_m, cosine, made)
    images[valid] = made
    return images


@compiled
def _spin(
    at: F64, facing: F64, points: F64, normals: F64, bin_m: float, cosine: float, images: F64
) -> None:
    bins = images.shape[1]
    half = bins / 2
    reach = (bins * bin_m) ** 2 * 1.25  # a corner: alpha of all bins and beta of half of them
    for m in range(len(at)):
        px, py, pz = at[m]
        nx, ny, nz = facing[m]
        image = images[m]
        for k in range(len(points)):
            dx, dy, dz = points[k, 0] - px, points[k, 1] - py, points[k, 2] - pz
            square = dx * dx + dy * dy + dz * dz
            if square > reach:
                continue
            if nx * normals[k, 0] + ny * normals[k, 1] + nz * normals[k, 2] < cosine:
                continue
            beta = nx * dx + ny * dy + nz * dz
            column = np.sqrt(max(square - beta * beta, 0.0)) / bin_m
            row = beta / bin_m + half
            i, j = int(np.floor(row)), int(column)
            a, b = row - i, column - j
            if i < -1 or i >= bins or j >= bins:
                continue
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
    count = len(images)
    flat, other = images.reshape(count, reference.size), reference.ravel()
    filled = flat > FILLED
    both = (filled & (other > FILLED)).astype(np.float64)
    n = both.sum(axis=1)
    found = np.full(count, NO_MATCH)
    enough = n >= max(overlap_min, 4)
    if not enough.any():
        return found
    n, both, a = n[enough], both[enough], flat[enough]
    b = other - other[other > FILLED].mean()
    a = (a - (both * a).sum(axis=1, keepdims=True) / n[:, None]) * both
    spread_b = both @ b**2 - (both @ b) ** 2 / n
    spread_a = (a**2).sum(axis=1)
    scale = np.sqrt(np.maximum(spread_a * spread_b, 0.0))
    r = np.divide(a @ b, scale, out=np.zeros_like(scale), where=scale > 1e-12)
    z = np.arctanh(np.clip(r, -R_MAX, R_MAX))
    half_filled = 0.5 * float(np.median(filled.sum(axis=1)))
    found[enough] = np.sign(r) * z**2 - half_filled / (n - 3)
    return found
