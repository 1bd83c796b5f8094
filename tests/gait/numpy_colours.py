"""The straightforward way to histograms of boxes: the reference for the compiled one."""

from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from people4d.messages import F64, U8
from services.gait.colour.histogram import HueSaturation
from services.gait.colour.pixel_ratios import Colours, Grid

I32: TypeAlias = npt.NDArray[np.int32]


class NumpyHueSaturation:
    """Tells the colours of many boxes of one image, in a time that no box's size changes.

    A box is looked at in a grid of points rather than in all its pixels. Points outside of the
    image have no colour but count, so that a box that leaves the image grows less alike.

    Args:
        hue_bins: Of hue.
        saturation_bins: Of saturation.
        points: Of a box, across and down.

    Source: method book section 8.1.
    """

    def __init__(self, hue_bins: int, saturation_bins: int, points: tuple[int, int]) -> None:
        self.bins = hue_bins * saturation_bins
        levels = np.arange(256)
        self._hue = (levels * hue_bins // 256 * saturation_bins).astype(np.int32)
        self._saturation = (levels * saturation_bins // 256).astype(np.int32)
        across, down = points
        # Where the points lie in a box from -1/2 to 1/2, each in the middle of its cell.
        self._u = (np.arange(across) + 0.5) / across - 0.5
        self._v = (np.arange(down) + 0.5) / down - 0.5

    def __call__(self, rgb: U8, boxes: F64) -> F64:
        """Return the histograms of boxes.

        Args:
            rgb: HxWx3.
            boxes: [px] Mx4: centre x, y, width, height.

        Returns:
            M x bins, share of the points; a row sums to the share inside of the image.
        """
        top, left, part = _part(rgb, boxes)
        height, width = part.shape[:2]
        shape = (len(boxes), self.bins + 1)
        counts = np.zeros(shape, np.int64)
        if height and width:
            bins = self._bins(part)
            u = np.floor(boxes[:, :1] + boxes[:, 2:3] * self._u).astype(np.int32) - left
            v = np.floor(boxes[:, 1:2] + boxes[:, 3:] * self._v).astype(np.int32) - top
            inside_u, inside_v = (u >= 0) & (u < width), (v >= 0) & (v < height)
            rows = np.clip(v, 0, height - 1) * width
            places = rows[:, :, None] + np.clip(u, 0, width - 1)[:, None, :]
            found = np.where(inside_v[:, :, None] & inside_u[:, None, :], bins[places], self.bins)
            found += (np.arange(len(boxes), dtype=np.int32) * (self.bins + 1))[:, None, None]
            counts = np.bincount(found.ravel(), minlength=counts.size).reshape(shape)
        return np.asarray(counts[:, :-1] / (len(self._u) * len(self._v)), np.float64)

    def _bins(self, rgb: U8) -> I32:
        """Return the bin of each pixel, row by row."""
        hsv = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV_FULL)
        found: I32 = self._hue[hsv[..., 0]] + self._saturation[hsv[..., 1]]
        return found.ravel()


def _part(rgb: U8, boxes: F64) -> tuple[int, int, U8]:
    """Return top, left and the pixels that any of the boxes covers."""
    height, width = rgb.shape[:2]
    low = (boxes[:, :2] - boxes[:, 2:] / 2).min(axis=0, initial=max(height, width))
    high = (boxes[:, :2] + boxes[:, 2:] / 2).max(axis=0, initial=0.0)
    left, top = np.clip(np.floor(low), 0, (width, height)).astype(int)
    right, bottom = np.clip(np.ceil(high) + 1, (left, top), (width, height)).astype(int)
    return int(top), int(left), rgb[top:bottom, left:right]


def scores(rgb: U8, boxes: F64, colours: Colours, grid: Grid, bins: HueSaturation) -> F64:
    """Return how much likelier boxes are the person; see `PixelRatios.scores`."""
    top, left, part = _part(rgb, boxes)
    height, width = part.shape[:2]
    if not height or not width:
        return np.zeros(len(boxes))
    hue, saturation = bins.tables
    hsv = cv2.cvtColor(part, cv2.COLOR_RGB2HSV_FULL)
    found = hue[hsv[..., 0]] + saturation[hsv[..., 1]]
    logs = np.log1p(np.arange(10)[:, None] / 10 * (colours.ratios[:, None] - 1))
    u = np.floor(boxes[:, :1] + boxes[:, 2:3] * grid.u).astype(np.int64) - left
    v = np.floor(boxes[:, 1:2] + boxes[:, 3:] * grid.v).astype(np.int64) - top
    inside = ((v >= 0) & (v < height))[:, :, None] & ((u >= 0) & (u < width))[:, None, :]
    rows, columns = np.clip(v, 0, height - 1)[:, :, None], np.clip(u, 0, width - 1)[:, None, :]
    values = logs[grid.bands[:, None], grid.tenths, found[rows, columns]]
    mean = (values * inside).mean(axis=(1, 2))
    return np.asarray(mean * boxes[:, 2] * boxes[:, 3])
