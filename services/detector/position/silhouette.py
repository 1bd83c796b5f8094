"""Mask of a person, grown in depth from the keypoints (docs/method.md section 8.2)."""

import cv2
import numpy as np

from people4d.messages import F32, F64, U8, U16
from services.detector.crops import cut_box
from services.detector.models.base import DetectedPerson, InstanceMask
from services.detector.position.surface import TORSO, DepthImage, read_depth

STEP_MIN_M = 0.01  # lower bound of the depth step between connected neighbours [Liu 2018] [m]
STEP_PER_M = 0.01  # maximum depth step between connected neighbours, divided by z^2 [1/m]
REACH_M = 0.4  # maximum distance of the person's pixels from the torso's depth [m]
SEED_CONFIDENCE_MIN = 0.3  # minimum confidence of keypoints that are seeds
PULL = 0.3  # shift of a seed from its joint to the torso's centre, off the outline
FLOOD = 4 | cv2.FLOODFILL_MASK_ONLY | 1 << 8  # 4 neighbours, write 1 into the mask


def grow_mask(person: DetectedPerson, image: DepthImage) -> InstanceMask | None:
    """Return the connected surface that holds the torso's keypoints, inside the box.

    None if no keypoint inside box and image is confident and validly read.

    Source: docs/method.md section 8.2 [Liu 2018], with the torso's component, not the largest.
    """
    depth_mm, max_depth_m = image.depth_mm, image.info.max_depth_m
    left, top, right, bottom = cut_box(person.box_xyxy_px, depth_mm.shape)
    if person.keypoints is None or left >= right or top >= bottom:
        return None
    window_mm = depth_mm[top:bottom, left:right]
    seeds = _seeds(person.keypoints) - np.array([left, top])
    seeds_m = read_depth(seeds, DepthImage(window_mm, image.info), window_px=3)
    if np.isnan(seeds_m).all():
        return None
    middle_m = float(np.nanmedian(seeds_m))
    surface_m = fill_holes(window_mm).astype(np.float32) / np.float32(1000)
    surface_m[(np.abs(surface_m - middle_m) > REACH_M) | (surface_m > max_depth_m)] = 0
    step_m = max(STEP_MIN_M, STEP_PER_M * middle_m**2)
    mask = _flood(surface_m, seeds, step_m)
    return InstanceMask(mask, x_px=left, y_px=top) if mask.any() else None


def fill_holes(depth_mm: U16) -> U16:
    """Set pixels without a reading (0) to the median of the readings among their 8 neighbours.

    Source: docs/method.md section 8.2 [Liu 2018].
    """
    read = (depth_mm > 0).astype(np.uint8)
    rows, columns = np.nonzero((read == 0) & (cv2.dilate(read, np.ones((3, 3), np.uint8)) > 0))
    padded = np.pad(depth_mm, 1)
    around = np.stack([padded[rows + i, columns + j] for i in range(3) for j in range(3)], axis=1)
    around.sort(axis=1)  # readings are after the zeros
    count, hole = np.count_nonzero(around, axis=1), np.arange(len(rows))
    below = around[hole, 9 - count + (count - 1) // 2].astype(np.uint32)
    above = around[hole, 9 - count + count // 2]
    filled = depth_mm.copy()
    filled[rows, columns] = (below + above) // 2
    return filled


def _seeds(keypoints: F32) -> F64:
    """Return pixels on the body (Nx2): the confident torso keypoints, else all confident ones."""
    pixels, confident = keypoints[:, :2].astype(np.float64), keypoints[:, 2] > SEED_CONFIDENCE_MIN
    if not confident[TORSO].any():
        return pixels[confident]
    pixels = pixels[TORSO][confident[TORSO]]
    centre = pixels.mean(axis=0)
    return np.vstack([pixels + (centre - pixels) * PULL, centre])


def _flood(surface_m: F32, seeds: F64, step_m: float) -> U8:
    """Return the pixels reached from the seeds in steps of depth below step_m; 0 is no surface."""
    height, width = surface_m.shape
    mask = np.zeros((height + 2, width + 2), np.uint8)
    for u, v in np.rint(seeds).astype(int):
        inside = 0 <= u < width and 0 <= v < height
        if inside and surface_m[v, u] > 0 and not mask[v + 1, u + 1]:
            cv2.floodFill(surface_m, mask, (int(u), int(v)), 1, step_m, step_m, FLOOD)
    return mask[1:-1, 1:-1]
