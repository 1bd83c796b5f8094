"""Crops of the people of a frame, small enough to publish."""

import cv2
import numpy as np

from people4d.messages import F32, U8, Crop
from services.detector.models.base import DetectedPerson


def cut_box(box_xyxy_px: F32, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom of the pixels of a box (xyxy) inside an image's shape."""
    height, width = shape[:2]
    left, top = np.clip(np.floor(box_xyxy_px[:2]), 0, (width, height)).astype(int)
    right, bottom = np.clip(np.ceil(box_xyxy_px[2:]), 0, (width, height)).astype(int)
    return int(left), int(top), int(right), int(bottom)


def crop_person(index: int, person: DetectedPerson, rgb: U8, height_max_px: int) -> Crop | None:
    """Cut one person out of an image (HxWx3), with mask and keypoints in the crop's pixels.

    The box is cut to the image, and a crop higher than `height_max_px` is scaled down to that. None
    if the box misses the image.
    """
    left, top, right, bottom = cut_box(person.box_xyxy_px, rgb.shape)
    if left >= right or top >= bottom:
        return None
    image = rgb[top:bottom, left:right]
    mask = None if person.mask is None else person.mask.cut((left, top, right, bottom))
    scale = np.ones(2)
    if bottom - top > height_max_px:
        size = (max(1, round((right - left) * height_max_px / (bottom - top))), height_max_px)
        scale = np.divide(size, (right - left, bottom - top))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)
        if mask is not None:
            mask = np.asarray(cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST), np.uint8)
    keypoints = None
    if person.keypoints is not None:  # pixel centres are whole numbers
        keypoints = person.keypoints.copy()
        moved = keypoints[:, :2] - (left, top) + 0.5
        keypoints[:, :2] = moved * scale.astype(np.float32) - 0.5
    return Crop(detection=index, rgb=image, mask=mask, keypoints=keypoints)
