"""Images and depth clouds for the page."""

from typing import Any

import cv2
import numpy as np

from common.io.images import encode_jpeg
from people4d.messages import F64, U8, U16, CameraInfo

IMAGE_WIDTH_PX = 640  # maximum width of images
JPEG_QUALITY = 75
CLOUD_WIDTH_PX = 128  # maximum columns of a depth cloud
NEAREST_MM = 200  # minimum depth of a cloud


def encode_image(rgb: U8) -> bytes:
    """Return the JPEG of an image (HxWx3, red first), shrunk to the maximum width."""
    height, width = rgb.shape[:2]
    if width > IMAGE_WIDTH_PX:
        size = (IMAGE_WIDTH_PX, max(1, round(height * IMAGE_WIDTH_PX / width)))
        rgb = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
    return encode_jpeg(rgb, JPEG_QUALITY)


def depth_cloud(rgb: U8, depth_mm: U16, info: CameraInfo, pose: F64) -> dict[str, Any]:
    """Return a subsampled frame, from which the page computes a cloud.

    Args:
        rgb: HxWx3, red first.
        depth_mm: HxW [mm].
        info: Calibration; lens distortion is ignored.
        pose: Pose of the optical frame in the frame of the tracks, 4x4.

    Returns:
        Size, depth [mm], colours, intrinsics of the small image, pose.
    """
    step = -(-depth_mm.shape[1] // CLOUD_WIDTH_PX)
    depth = depth_mm[step // 2 :: step, step // 2 :: step]
    far = info.max_depth_m * 1000
    depth = np.where((depth < NEAREST_MM) | (depth > far), 0, depth).astype("<u2")
    colours = rgb[step // 2 :: step, step // 2 :: step]
    return {
        "width": depth.shape[1],
        "height": depth.shape[0],
        "depth_mm": depth.tobytes(),
        "rgb": np.ascontiguousarray(colours).tobytes(),
        "fx": info.fx / step,
        "fy": info.fy / step,
        "cx": (info.cx - step // 2) / step,
        "cy": (info.cy - step // 2) / step,
        "pose": pose.ravel().tolist(),
    }
