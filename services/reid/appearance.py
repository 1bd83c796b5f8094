"""The appearance network, a small one trained on simulated people by scripts/train_embedding."""

import cv2
import numpy as np

from people4d.messages import F32, HIDDEN_RGB, Crop
from services.reid.network import NetworkEmbedder


class AppearanceEmbedder(NetworkEmbedder):
    """Embedder by colour and texture, from Nx4xHxW (RGB and mask, 0 to 1) to NxD."""

    usual_name = "appearance"
    channels = 4  # red, green, blue, mask

    def draw(self, crop: Crop, tensor: F32) -> None:
        """Write colours and mask, 4xHxW.

        Without a mask, the whole crop except its hidden pixels counts as the person.
        """
        height, width = self.size
        resized = cv2.resize(crop.rgb, (width, height), interpolation=cv2.INTER_AREA)
        np.divide(resized.transpose(2, 0, 1), np.float32(255), out=tensor[:3])
        tensor[3] = 1.0
        hidden = cv2.inRange(crop.rgb, HIDDEN_RGB, HIDDEN_RGB)
        if crop.mask is not None and crop.mask.any():
            hidden[crop.mask == 0] = 1
        count = cv2.countNonZero(hidden)
        if 0 < count < hidden.size:
            visible = (hidden == 0).astype(np.float32)
            share = cv2.resize(visible, (width, height), interpolation=cv2.INTER_AREA)
            np.greater(share, 0.5, out=tensor[3])


load = AppearanceEmbedder.load
