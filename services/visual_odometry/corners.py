"""Corners of an image: depth, people on them, and optical flow to another image."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from common.geometry.transforms import deproject
from people4d.messages import F32, F64, U8, U16, CameraInfo
from services.visual_odometry.reprojection import Flags

CELL_PX = 12  # side of the grid cells, each with one corner [px]
BLOCK_PX = 5  # side of the block whose contrast is measured [px]
SOBEL = 8 / (4 * BLOCK_PX * 255)  # OpenCV's response to one grey level per pixel
CONTRAST_MIN = 1.5  # minimum contrast of a corner along its weaker direction [grey levels/px]
PATCH = np.array([(x, y) for y in range(-2, 3) for x in range(-2, 3)])
READ_SHARE = 0.5  # minimum share of valid depth readings in the patch of a corner
EDGE_SHARE = 0.04  # maximum range of depth in a patch, relative to its median
PEOPLE_MARGIN = 0.15  # margin of a person's box, relative to its sides
PEOPLE_DEPTH_M = 0.7  # half the thickness of the region of a person along the optical axis [m]
WINDOW_PX = 17  # side of the windows compared by optical flow [px]
LEVELS = 3  # halvings of the image for forward flow
BACK_LEVELS = 1  # halvings of the image for backward flow, which begins at the expected end
STEPS = 15  # maximum number of iterations on each level
EIGENVALUE_MIN = 1e-4  # OpenCV's minimum eigenvalue of a window with enough contrast
BACK_MAX_PX = 1.0  # maximum distance to the start after forward and backward flow [px]
RANGE_M = (0.3, 10.0)  # minimum and maximum valid depth
SMALL = 4  # reduction of the images for phase correlation


@dataclass(frozen=True)
class PeopleRegions:
    """Regions of people in an image."""

    # [px] Nx4, in the full image
    boxes_xyxy_px: F64 = field(default_factory=lambda: np.empty((0, 4)))
    # [m] N, along the optical axis; NaN if unknown
    depths_m: F64 = field(default_factory=lambda: np.empty(0))

    def cover_points(self, pixels: F64, depths_m: F64) -> Flags:
        """Flag the points (N; pixels Nx2 in the full image) that may be on people."""
        covered = np.zeros(len(pixels), np.bool_)
        for box, depth_m in zip(self.boxes_xyxy_px, self.depths_m, strict=True):
            margin = PEOPLE_MARGIN * (box[2:] - box[:2])
            inside = np.all((pixels >= box[:2] - margin) & (pixels <= box[2:] + margin), axis=1)
            far = np.abs(depths_m - depth_m) > PEOPLE_DEPTH_M  # False if a depth is NaN
            covered |= inside & ~far
        return covered


@dataclass(frozen=True)
class OdometryFrame:
    """Images of one frame, and the regions of people in it."""

    stamp_ns: int
    rgb: U8  # HxWx3, red first
    depth_mm: U16  # HxW, 0 = no reading
    people: PeopleRegions = field(default_factory=PeopleRegions)


@dataclass(frozen=True)
class ReducedCamera:
    """Calibration of the full images, and their reduced width."""

    info: CameraInfo
    width_px: int  # maximum width of a reduced image

    @property
    def scale(self) -> float:
        """Ratio of full to reduced width."""
        return max(self.info.width / self.width_px, 1.0)

    @property
    def focal_px(self) -> float:
        """Focal length in reduced pixels."""
        return (self.info.fx + self.info.fy) / 2 / self.scale

    def reduce_image(self, rgb: U8) -> U8:
        """Return the reduced grey image of a full colour image."""
        grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
        if self.scale > 1:
            size = (self.width_px, round(self.info.height / self.scale))
            grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        return np.asarray(grey, np.uint8)

    def to_full(self, pixels: F32) -> F64:
        """Convert pixels (Nx2) of the reduced image to the full image."""
        return (pixels.astype(np.float64) + 0.5) * self.scale - 0.5

    def to_reduced(self, pixels: F64) -> F32:
        """Convert pixels (Nx2) of the full image to the reduced image."""
        return ((pixels + 0.5) / self.scale - 0.5).astype(np.float32)

    def rays(self, pixels: F32) -> F64:
        """Return undistorted rays, x / z and y / z (Nx2), of pixels of the reduced image."""
        return deproject(self.to_full(pixels), np.ones(len(pixels)), self.info)[:, :2]


def find_corners(grey: U8) -> F32:
    """Return the best corner of each cell (Nx2), in order; docs/method.md section 18 [Shi 1994]."""
    half, cell = cv2.pyrDown(grey), CELL_PX // 2  # half size: fine texture is lost by blur
    rows, columns = half.shape[0] // cell, half.shape[1] // cell
    if not rows or not columns:
        return np.empty((0, 2), np.float32)
    strength = cv2.cornerMinEigenVal(half, BLOCK_PX)[: rows * cell, : columns * cell]
    cells = strength.reshape(rows, cell, columns, cell).swapaxes(1, 2).reshape(-1, cell * cell)
    best = cells.argmax(axis=1)
    row, column = np.divmod(np.arange(len(best)), columns)
    pixels = np.stack([column * cell + best % cell, row * cell + best // cell], axis=1)
    strengths = cells[np.arange(len(best)), best]
    least = (BLOCK_PX * SOBEL * 2 * CONTRAST_MIN) ** 2
    order = np.argsort(-strengths, kind="stable")
    return np.asarray(2 * pixels[order[strengths[order] > least]], np.float32)


def read_depth_m(depth_mm: U16, pixels: F64) -> tuple[F64, Flags]:
    """Return the depth (N) at points (Nx2), and flags (N) of points beyond the sensor's range.

    Depth is NaN at the edge of a surface, outside the range, or unread. A patch with no
    reading is beyond the range.
    """
    size = np.array(depth_mm.shape[::-1])
    at = np.rint(pixels).astype(np.int64)[:, None] + PATCH
    at = at.clip(0, size - 1)
    found = np.sort(depth_mm[at[..., 1], at[..., 0]].astype(np.float64) / 1000, axis=1)
    missing = len(PATCH) - np.count_nonzero(found, axis=1)  # zeros are sorted first
    last, each = len(PATCH) - 1, np.arange(len(found))
    middle = found[each, np.minimum((missing + last + 1) // 2, last)]
    spread = found[:, -1] - found[each, np.minimum(missing, last)]
    good = (missing <= len(PATCH) * (1 - READ_SHARE)) & (spread <= EDGE_SHARE * middle)
    good &= (middle >= RANGE_M[0]) & (middle <= RANGE_M[1])
    return np.where(good, middle, np.nan), missing == len(PATCH)


def track_points(before: U8, now: U8, pixels: F32, guess: F32) -> tuple[F32, Flags]:
    """Track points (Nx2) between two grey images (HxW), from predicted positions (`guess`, Nx2).

    Returns the positions in the second image (Nx2), and flags of the valid positions (N).

    Source: pyramidal Lucas-Kanade [Lucas 1981] [Bouguet 2001], forward and backward.
    """
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, STEPS, 0.03)

    def flow(start: U8, end: U8, points: F32, guessed: F32, levels: int) -> tuple[F32, Flags]:
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            start,
            end,
            points[:, None],
            guessed[:, None].copy(),
            winSize=(WINDOW_PX, WINDOW_PX),
            maxLevel=levels,
            criteria=until,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            minEigThreshold=EIGENVALUE_MIN,
        )
        return np.asarray(found[:, 0], np.float32), status[:, 0] != 0

    if not len(pixels):
        return np.empty((0, 2), np.float32), np.empty(0, np.bool_)
    found, forward = flow(before, now, pixels, guess, LEVELS)
    back, backward = flow(now, before, found, pixels, BACK_LEVELS)
    size = np.array(now.shape[::-1])
    inside = np.all((found >= 0) & (found <= size - 1), axis=1)
    near = np.linalg.norm(back - pixels, axis=1) <= BACK_MAX_PX
    return found, forward & backward & inside & near


def reduce_for_shift(grey: U8) -> F32:
    """Return the image reduced for phase correlation."""
    size = grey.shape[1] // SMALL, grey.shape[0] // SMALL
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.float32)


def shift_px(before: F32, now: F32) -> F32:
    """Return the shift (2) of the whole image, from two reduced images [Kuglin 1975]."""
    window = cv2.createHanningWindow(before.shape[::-1], cv2.CV_32F)
    moved, _ = cv2.phaseCorrelate(before, now, window)
    return np.array(moved, np.float32) * SMALL
