"""Optical flow: points of one image in another."""

import cv2
import numpy as np

from people4d.messages import F32, U8
from services.visual_odometry.config import FlowConfig
from services.visual_odometry.reprojection import Flags

SMALL = 4  # pixels in one of a small image
BACK_LEVELS = 1  # backward flow begins where it should end
CONTRAST_MIN = 1e-4  # OpenCV's: patches without contrast have no flow


def track_points(
    before: U8, now: U8, pixels: F32, guess: F32, config: FlowConfig
) -> tuple[F32, Flags]:
    """Return the positions of points now (Nx2), and flags of those that are valid (N).

    Their positions before are given, and predicted ones now (Nx2 each), in grey images (HxW).

    Source: pyramidal Lucas-Kanade [Lucas 1981] [Bouguet 2001], forward and backward.
    """
    window = config.window_px, config.window_px
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, config.steps, 0.03)

    def flow(start: U8, end: U8, points: F32, guessed: F32, levels: int) -> tuple[F32, Flags]:
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            start,
            end,
            points[:, None],
            guessed[:, None].copy(),
            winSize=window,
            maxLevel=levels,
            criteria=until,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            minEigThreshold=CONTRAST_MIN,
        )
        return np.asarray(found[:, 0], np.float32), status[:, 0] != 0

    if not len(pixels):
        return np.empty((0, 2), np.float32), np.empty(0, np.bool_)
    found, forward = flow(before, now, pixels, guess, config.levels)
    back, backward = flow(now, before, found, pixels, BACK_LEVELS)
    size = np.array(now.shape[::-1])
    inside = np.all((found >= 0) & (found <= size - 1), axis=1)
    near = np.linalg.norm(back - pixels, axis=1) <= config.back_max_px
    return found, forward & backward & inside & near


def small(grey: U8) -> F32:
    """Return a small image for phase correlation."""
    size = grey.shape[1] // SMALL, grey.shape[0] // SMALL
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.float32)


def shift_px(before: F32, now: F32) -> F32:
    """Return the shift (2) of most of an image, from two small ones [Kuglin 1975]."""
    window = cv2.createHanningWindow(before.shape[::-1], cv2.CV_32F)
    moved, _ = cv2.phaseCorrelate(before, now, window)
    return np.array(moved, np.float32) * SMALL
