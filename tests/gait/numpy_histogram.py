"""NumPy references of the compiled histograms of boxes."""

import numpy as np

from benchmarks.lib.gait.numpy_scores import sampled_bins
from people4d.messages import F64, U8
from services.gait.colour.histogram import HueSaturationHistogram, sample_grid


def histograms(rgb: U8, boxes: F64, points: tuple[int, int], bins: HueSaturationHistogram) -> F64:
    """Return the histograms of boxes, see `HueSaturationHistogram`."""
    found, inside = sampled_bins(rgb, boxes, sample_grid(points), bins)
    found = np.where(inside, found, bins.bins).reshape(len(boxes), -1)
    counts = np.stack([np.bincount(row, minlength=bins.bins + 1) for row in found])
    return np.asarray(counts[:, :-1] / (points[0] * points[1]), np.float64)


def bhattacharyya(p: F64, q: F64) -> F64:
    """Return the Bhattacharyya distances of histograms, ... x bins."""
    coefficient = np.sqrt(p * q).sum(axis=-1)
    return np.asarray(np.sqrt(np.clip(1.0 - coefficient, 0.0, 1.0)))
