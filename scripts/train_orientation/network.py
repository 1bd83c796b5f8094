"""The orientation network: the yaw of a person from a crop of the upper body."""

import torch  # type: ignore[import-not-found]
from torch import Tensor, nn

from scripts.train_embedding.network import grid_features, grid_head

SIZE_PX = (64, 48)  # [px] height and width of the input
SECTORS = 24  # number of sectors of the yaw; the first is around 0, facing away
FEATURES = (32, 64, 128)  # numbers of features, from fine to coarse
CELL = 32  # number of features of each of the 8x6 cells
HIDDEN = 128


class OrientationNetwork(nn.Module):  # type: ignore[misc]
    """Nx4x64x48 (RGB and mask, 0 to 1) to Nx24 log probabilities of the sectors of the yaw."""

    def __init__(self) -> None:
        super().__init__()
        self.features = grid_features(4, FEATURES, CELL)
        self.head = grid_head(CELL, SIZE_PX, HIDDEN, SECTORS)

    def forward(self, images: Tensor) -> Tensor:
        """Return the log probabilities of images."""
        return torch.log_softmax(self.head(self.features(images)), 1)
