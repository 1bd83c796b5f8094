"""NumPy version of the compiled scores of boxes, to compare their times."""

import cv2
import numpy as np

from people4d.messages import F64, U8
from services.gait.colour.colour_ratio import ColourModel, person_prior
from services.gait.colour.histogram import HueSaturationHistogram, SampleGrid


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
