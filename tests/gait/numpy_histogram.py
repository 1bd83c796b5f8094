"""NumPy references of the compiled histograms and scores of boxes."""

import cv2
import numpy as np

from people4d.messages import F64, U8
from services.gait.colour.colour_ratio import ColourModel, person_prior
from services.gait.colour.histogram import HueSaturationHistogram, SampleGrid, sample_grid


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


def scores(
    rgb: U8, boxes: F64, model: ColourModel, grid: SampleGrid, bins: HueSaturationHistogram
) -> F64:
    """Return the log-likelihood ratios of boxes, see `ColourRatio.scores`."""
    found, inside = sampled_bins(rgb, boxes, grid, bins)
    logs = np.log1p(np.arange(10)[:, None] / 10 * (model.ratios[:, None] - 1))
    prior = person_prior(grid, len(model.person))
    values = logs[prior.bands[:, None], prior.tenths, found]
    mean = (values * inside).mean(axis=(1, 2))
    return np.asarray(mean * boxes[:, 2] * boxes[:, 3])


def sampled_bins(
    rgb: U8, boxes: F64, grid: SampleGrid, bins: HueSaturationHistogram
) -> tuple[np.ndarray, np.ndarray]:
    """Return the bins of the samples, M x rows x columns, and their mask inside of the image."""
    height, width = rgb.shape[:2]
    hue, saturation = bins.tables
    hsv = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV_FULL)
    of_pixels = hue[hsv[..., 0]] + saturation[hsv[..., 1]]
    u = np.floor(boxes[:, :1] + boxes[:, 2:3] * grid.u).astype(np.int64)
    v = np.floor(boxes[:, 1:2] + boxes[:, 3:] * grid.v).astype(np.int64)
    inside = ((v >= 0) & (v < height))[:, :, None] & ((u >= 0) & (u < width))[:, None, :]
    rows, columns = np.clip(v, 0, height - 1)[:, :, None], np.clip(u, 0, width - 1)[:, None, :]
    return of_pixels[rows, columns], inside
