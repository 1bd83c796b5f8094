"""The appearance network, a small one trained on simulated people by scripts/train_embedding."""

import cv2
import numpy as np

from people4d.messages import F32, HIDDEN_RGB, Crop
from services.reid.network import NetworkEmbedder


class AppearanceEmbedder(NetworkEmbedder):
    """Colour and texture of the visible parts: Nx4xHxW, RGB and mask, 0 to 1, to NxD."""

    usual_name = "appearance"
    channels = 4  # red, green, blue, mask

    def tensor(self, crop: Crop) -> F32:
        """Return colours and mask, 4xHxW.

        Without a mask, the whole crop except its hidden pixels counts as the person.
        """
        height, width = self.size
        resized = cv2.resize(crop.rgb, (width, height), interpolation=cv2.INTER_AREA)
        tensor = np.ones((self.channels, height, width), np.float32)
        tensor[:3] = resized.transpose(2, 0, 1) / np.float32(255)
        visible = cv2.inRange(crop.rgb, HIDDEN_RGB, HIDDEN_RGB) == 0
        if crop.mask is not None and crop.mask.any():
            visible &= crop.mask != 0
        if visible.any() and not visible.all():
            share = cv2.resize(
                visible.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA
            )
            tensor[3] = share > 0.5
        return tensor


load = AppearanceEmbedder.load
