"""OSNet: a small network trained to distinguish people by their appearance."""

import cv2
import numpy as np

from people4d.messages import F32, Crop
from services.reid.network import NetworkEmbedder

# Mean and standard deviation of ImageNet, red first, values 0 to 1
MEAN = np.array([0.485, 0.456, 0.406], np.float32)
DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)


class OsnetEmbedder(NetworkEmbedder):
    """OSNet in torchreid's ONNX layout: Nx3x256x128, ImageNet mean and deviation, to NxD."""

    usual_name = "osnet"
    channels = 3
    default_size = (256, 128)

    def draw(self, crop: Crop, tensor: F32) -> None:
        """Write colours, 3xHxW."""
        height, width = self.size
        shrinks = crop.rgb.shape[0] > height and crop.rgb.shape[1] > width
        method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
        resized = cv2.resize(crop.rgb, (width, height), interpolation=method)
        values = (np.asarray(resized, np.float32) / 255 - MEAN) / DEVIATION
        tensor[:] = values.transpose(2, 0, 1)


load = OsnetEmbedder.load
