"""Crops of the people of a frame, small enough to publish.

Occluders in front of a person are blanked, so their appearance does not enter the embedding.
The background stays: networks for re-identification are trained with it, and recognise fewer people
without it (docs/method.md section 21).
"""

import math

import cv2
import numpy as np
import numpy.typing as npt

from people4d.messages import F32, HIDDEN_RGB, U8, U16, Crop
from services.detector.models.base import DetectedPerson

Flags = npt.NDArray[np.bool_]
FRONT_M = 0.4  # minimum distance of blanked pixels in front of the person's layer [m]
HIDDEN_MAX = 0.7  # maximum blanked share of a crop; above it the depth is wrong


def cut_box(box_xyxy_px: F32, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom of the pixels of a box (xyxy) inside an image's shape."""
    height, width = shape[:2]
    left, top, right, bottom = box_xyxy_px.tolist()
    return (
        math.floor(min(max(0.0, left), width)),
        math.floor(min(max(0.0, top), height)),
        math.ceil(min(max(0.0, right), width)),
        math.ceil(min(max(0.0, bottom), height)),
    )


def hidden_pixels(box_xyxy_px: F32, depth_mm: U16, nearest_m: float) -> Flags | None:
    """Return a mask of the pixels in a box nearer than a depth; None if there are none.

    Pixels without a reading do not count. None if too many are nearer: the depth is wrong.
    """
    left, top, right, bottom = cut_box(box_xyxy_px, depth_mm.shape)
    if left >= right or top >= bottom or not 0 < nearest_m < math.inf:
        return None
    window_mm = depth_mm[top:bottom, left:right]
    # Minus 1, a missing reading wraps to the farthest: one comparison for both.
    nearest_mm = min(round(nearest_m * 1000) - 1, 65535)
    hidden = (window_mm - np.uint16(1)) < max(nearest_mm, 0)
    count = np.count_nonzero(hidden)
    return hidden if 0 < count <= HIDDEN_MAX * hidden.size else None


def crop_person(
    index: int, person: DetectedPerson, rgb: U8, height_max_px: int, hidden: Flags | None = None
) -> Crop | None:
    """Cut one person out of an image (HxWx3), with mask and keypoints in the crop's pixels.

    The box is cut to the image, and a crop higher than `height_max_px` is scaled down to it; its
    hidden pixels get the colour HIDDEN_RGB. None if the box misses the image.
    """
    left, top, right, bottom = cut_box(person.box_xyxy_px, rgb.shape)
    if left >= right or top >= bottom:
        return None
    image = rgb[top:bottom, left:right]
    mask = None if person.mask is None else person.mask.cut((left, top, right, bottom))
    scale = 1.0, 1.0
    if bottom - top > height_max_px:
        size = (max(1, round((right - left) * height_max_px / (bottom - top))), height_max_px)
        scale = size[0] / (right - left), size[1] / (bottom - top)
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)
        if mask is not None:
            mask = np.asarray(cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST), np.uint8)
    if hidden is not None:
        image = _blank(image, hidden)
    keypoints = None
    if person.keypoints is not None:  # pixel centres are whole numbers
        keypoints = person.keypoints.copy()
        moved = keypoints[:, :2] - (left, top) + 0.5
        keypoints[:, :2] = moved * np.array(scale, np.float32) - 0.5
    return Crop(detection=index, rgb=image, mask=mask, keypoints=keypoints)


def _blank(image: U8, hidden: Flags) -> U8:
    """Blank the hidden pixels, given at any scale."""
    height, width = image.shape[:2]
    visible = (~hidden).view(np.uint8)
    if visible.shape != (height, width):
        scaled = cv2.resize(visible, (width, height), interpolation=cv2.INTER_NEAREST)
        visible = np.asarray(scaled, np.uint8)
    blanked = np.empty_like(image)
    blanked[0] = HIDDEN_RGB
    blanked[1:] = blanked[0]  # a row at once, which is fast
    return np.asarray(cv2.copyTo(image, visible, blanked), np.uint8)
