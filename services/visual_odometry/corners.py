"""Corners of an image: their depth, people on them, and their optical flow to another image."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F32, F64, U8, U16, CameraInfo
from services.visual_odometry.config import CornerConfig, FlowConfig
from services.visual_odometry.reprojection import Flags

BLOCK_PX = 5  # side of the block of which a corner has the contrast
SOBEL = 8 / (4 * BLOCK_PX * 255)  # value of OpenCV for one grey level a pixel
PATCH = np.array([(x, y) for y in range(-2, 3) for x in range(-2, 3)])
SMALL = 4  # pixels in one of a small image
BACK_LEVELS = 1  # backward flow begins where it should end
CONTRAST_MIN = 1e-4  # OpenCV's: patches without contrast have no flow
READ_SHARE = 0.5  # of a corner's surroundings that must have depth


@dataclass(frozen=True)
class PeopleRegions:
    """Regions of people in an image."""

    # [px] Nx4, in the full image
    boxes_xyxy_px: F64 = field(default_factory=lambda: np.empty((0, 4)))
    # [m] N, along the optical axis; NaN if unknown
    depths_m: F64 = field(default_factory=lambda: np.empty(0))

    def cover(self, pixels: F64, depths_m: F64, config: CornerConfig) -> Flags:
        """Return the points (N; pixels Nx2 in the full image) that may be on people."""
        covered = np.zeros(len(pixels), np.bool_)
        for box, depth_m in zip(self.boxes_xyxy_px, self.depths_m, strict=True):
            margin = config.people_margin * (box[2:] - box[:2])
            inside = np.all((pixels >= box[:2] - margin) & (pixels <= box[2:] + margin), axis=1)
            far = np.abs(depths_m - depth_m) > config.people_depth_m  # not, where it is NaN
            covered |= inside & ~far
        return covered


@dataclass(frozen=True)
class OdometryFrame:
    """One frame."""

    stamp_ns: int
    rgb: U8  # HxWx3, red first
    depth_mm: U16  # HxW, 0 = no reading
    people: PeopleRegions = field(default_factory=PeopleRegions)


@dataclass(frozen=True)
class ReducedCamera:
    """A calibration of full images, and the width that they are reduced to."""

    info: CameraInfo
    width_px: int  # most columns

    @property
    def scale(self) -> float:
        """Full pixels in a reduced one."""
        return max(self.info.width / self.width_px, 1.0)

    @property
    def focal_px(self) -> float:
        """Focal length in reduced pixels."""
        return (self.info.fx + self.info.fy) / 2 / self.scale

    def grey(self, rgb: U8) -> U8:
        """Return the reduced image."""
        grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
        if self.scale > 1:
            size = (self.width_px, round(self.info.height / self.scale))
            grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        return np.asarray(grey, np.uint8)

    def to_full(self, pixels: F32) -> F64:
        """Return the pixels in the full image of points (Nx2) of the reduced one."""
        return (pixels.astype(np.float64) + 0.5) * self.scale - 0.5

    def to_reduced(self, pixels: F64) -> F32:
        """Return the pixels in the reduced image of points (Nx2) of the full one."""
        return ((pixels + 0.5) / self.scale - 0.5).astype(np.float32)

    def rays(self, pixels: F32) -> F64:
        """Return x / z and y / z (Nx2) of points of the reduced image, distortion removed."""
        return deproject(self.to_full(pixels), np.ones(len(pixels)), self.info)[:, :2]


def find_corners(grey: U8, config: CornerConfig) -> F32:
    """Return the best corners (Nx2) of an image, one of each cell, the best first.

    Source: docs/method.md section 18 [Shi 1994].
    """
    half, cell = cv2.pyrDown(grey), config.cell_px // 2  # finer ones are lost in blur
    rows, columns = half.shape[0] // cell, half.shape[1] // cell
    if not rows or not columns:
        return np.empty((0, 2), np.float32)
    strength = cv2.cornerMinEigenVal(half, BLOCK_PX)[: rows * cell, : columns * cell]
    cells = strength.reshape(rows, cell, columns, cell).swapaxes(1, 2).reshape(-1, cell * cell)
    best = cells.argmax(axis=1)
    row, column = np.divmod(np.arange(len(best)), columns)
    pixels = np.stack([column * cell + best % cell, row * cell + best // cell], axis=1)
    strengths = cells[np.arange(len(best)), best]
    least = (BLOCK_PX * SOBEL * 2 * config.contrast_min) ** 2
    order = np.argsort(-strengths, kind="stable")
    return np.asarray(2 * pixels[order[strengths[order] > least]], np.float32)


def read_depth_m(depth_mm: U16, pixels: F64, config: CornerConfig) -> tuple[F64, Flags]:
    """Return the depth (N) at points (Nx2), and flags (N) of those too far for the sensor.

    Depth is NaN at the rim of a surface and where there is none; the latter are too far.
    """
    size = np.array(depth_mm.shape[::-1])
    at = np.rint(pixels).astype(np.int64)[:, None] + PATCH
    at = at.clip(0, size - 1)
    found = np.sort(depth_mm[at[..., 1], at[..., 0]].astype(np.float64) / 1000, axis=1)
    missing = len(PATCH) - np.count_nonzero(found, axis=1)  # these come first
    last, each = len(PATCH) - 1, np.arange(len(found))
    middle = found[each, np.minimum((missing + last + 1) // 2, last)]
    spread = found[:, -1] - found[each, np.minimum(missing, last)]
    good = (missing <= len(PATCH) * (1 - READ_SHARE)) & (spread <= config.edge_share * middle)
    good &= (middle >= config.range_min_m) & (middle <= config.range_max_m)
    return np.where(good, middle, np.nan), missing == len(PATCH)


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
