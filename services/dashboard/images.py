"""Images and depth clouds for the page."""

from typing import Any

import cv2
import numpy as np

from common.io.images import encode_jpeg
from people4d.messages import F64, U8, U16, CameraInfo

NEAREST_MM = 200


def encode_image(rgb: U8, width_max: int, quality: int) -> bytes:
    """Return the JPEG of an image (HxWx3, red first), shrunk to a width in pixels at most."""
    height, width = rgb.shape[:2]
    if width > width_max:
        size = (width_max, max(1, round(height * width_max / width)))
        rgb = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
    return encode_jpeg(rgb, quality)


def depth_cloud(
    rgb: U8, depth_mm: U16, info: CameraInfo, pose: F64, columns_max: int
) -> dict[str, Any]:
    """Return every few pixels of a frame, from which the page makes a cloud.

    Args:
        rgb: HxWx3, red first.
        depth_mm: HxW [mm].
        info: Calibration; lens distortion is left out.
        pose: 4x4 pose of the optical frame in that of the tracks.
        columns_max: Columns of the cloud at most.

    Returns:
        Size, depth [mm], colours, intrinsics of the small image, pose.
    """
    step = -(-depth_mm.shape[1] // columns_max)
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
