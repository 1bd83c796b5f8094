"""Images and calibrations as ROS messages; images.py and camera.py are the inverse.

The functions return the fields of a message as nested mappings, for `types.encode`.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from common.io.images import encode_jpeg, encode_png16
from common.ros2.types import Fields
from people4d.messages import CameraInfo
from services.camera.ros.images import COMPRESSED_DEPTH_HEADER

QUALITY = 95  # JPEG quality of colour, high since colour is encoded a second time


def image(pixels: npt.NDArray[Any], head: Fields) -> Fields:
    """Return a sensor_msgs/Image of colour (HxWx3) or of depth (HxW, millimetres)."""
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
    return {
        "header": head,
        "height": pixels.shape[0],
        "width": pixels.shape[1],
        "encoding": "rgb8" if pixels.ndim == 3 else "16UC1",
        "step": rows.shape[1],
        "data": rows.reshape(-1),
    }


def compressed_image(pixels: npt.NDArray[Any], head: Fields) -> Fields:
    """Return a sensor_msgs/CompressedImage of colour (HxWx3) or of depth (HxW, millimetres).

    Depth has the format of compressed_depth_image_transport.
    """
    if pixels.ndim == 3:
        layout, data = "rgb8; jpeg compressed bgr8", encode_jpeg(pixels, QUALITY)
    else:
        layout = "16UC1; compressedDepth png"
        data = COMPRESSED_DEPTH_HEADER.pack(0, 0.0, 0.0) + encode_png16(pixels)
    return {"header": head, "format": layout, "data": np.frombuffer(data, np.uint8)}


def camera_info(info: CameraInfo, head: Fields) -> Fields:
    """Return a sensor_msgs/CameraInfo."""
    k = np.array([info.fx, 0, info.cx, 0, info.fy, info.cy, 0, 0, 1], np.float64)
    none = info.distortion_model == "none"
    return {
        "header": head,
        "height": info.height,
        "width": info.width,
        "distortion_model": "plumb_bob" if none else info.distortion_model,
        "d": np.zeros(5) if none else np.array(info.distortion, np.float64),
        "k": k,
        "r": np.eye(3).ravel(),
        "p": np.insert(k.reshape(3, 3), 3, 0.0, axis=1).ravel(),
    }
