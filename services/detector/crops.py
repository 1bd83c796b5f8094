"""Crops of the people of a frame, small enough to publish."""

import cv2
import numpy as np

from people4d.messages import F32, U8, Crop
from services.detector.models.base import DetectedPerson, InstanceMask


def cut_box(box_xyxy_px: F32, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom of the pixels of a box (xyxy) inside an image's shape."""
    height, width = shape[:2]
    left, top = np.clip(np.floor(box_xyxy_px[:2]), 0, (width, height)).astype(int)
    right, bottom = np.clip(np.ceil(box_xyxy_px[2:]), 0, (width, height)).astype(int)
    return int(left), int(top), int(right), int(bottom)


def crop_person(index: int, person: DetectedPerson, rgb: U8, height_max_px: int) -> Crop | None:
    """Cut one person out of an image.

    Args:
        index: Index of the detection.
        person: The person, in pixels of the image.
        rgb: HxWx3 image.
        height_max_px: A higher crop is scaled down to this height.

    Returns:
        The box cut to the image, with mask and keypoints in the crop's pixels; None if the box
        misses the image.
    """
    left, top, right, bottom = cut_box(person.box_xyxy_px, rgb.shape)
    if left >= right or top >= bottom:
        return None
    image = rgb[top:bottom, left:right]
    mask = None if person.mask is None else _cut_mask(person.mask, (left, top, right, bottom))
    scale = np.ones(2)
    if bottom - top > height_max_px:
        size = (max(1, round((right - left) * height_max_px / (bottom - top))), height_max_px)
        scale = np.divide(size, (right - left, bottom - top))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)
        if mask is not None:
            mask = np.asarray(cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST), np.uint8)
    keypoints = _move(person.keypoints, (left, top), scale.astype(np.float32))
    return Crop(detection=index, rgb=image, mask=mask, keypoints=keypoints)


def _cut_mask(mask: InstanceMask, box: tuple[int, int, int, int]) -> U8:
    """Return the pixels of a mask inside a box of pixels."""
    left, top, right, bottom = box
    height, width = mask.window.shape
    cut = np.zeros((bottom - top, right - left), np.uint8)
    first_u, last_u = max(left, mask.x_px), min(right, mask.x_px + width)
    first_v, last_v = max(top, mask.y_px), min(bottom, mask.y_px + height)
    if first_u < last_u and first_v < last_v:
        cut[first_v - top : last_v - top, first_u - left : last_u - left] = mask.window[
            first_v - mask.y_px : last_v - mask.y_px, first_u - mask.x_px : last_u - mask.x_px
        ]
    return cut


def _move(keypoints: F32 | None, corner_px: tuple[int, int], scale: F32) -> F32 | None:
    """Return keypoints in the pixels of a crop; pixel centres are whole numbers."""
    if keypoints is None:
        return None
    moved = keypoints.copy()
    moved[:, :2] = (keypoints[:, :2] - corner_px + 0.5) * scale - 0.5
    return moved
