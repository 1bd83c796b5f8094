"""The orientation network: the yaw of a person from a crop of the upper body."""

import torch  # type: ignore[import-not-found]
from torch import Tensor, nn

from scripts.train_embedding.network import Residual, convolution

SIZE_PX = (64, 48)  # [px] height and width of the input
SECTORS = 24  # number of sectors of the yaw; the first is around 0, facing away
COARSE, MIDDLE, FINE = 128, 64, 32  # numbers of features
CELL = 32  # number of features of each of the 8x6 cells
HIDDEN = 128


class OrientationNetwork(nn.Module):  # type: ignore[misc]
    """Nx4x64x48 (RGB and mask, 0 to 1) to Nx24 log probabilities of the sectors of the yaw."""

    def __init__(self) -> None:
        super().__init__()
        self.features = nn.Sequential(
            convolution(4, FINE, 2),
            convolution(FINE, MIDDLE, 2),
            Residual(MIDDLE),
            convolution(MIDDLE, COARSE, 2),
            Residual(COARSE),
            nn.Conv2d(COARSE, CELL, 1),
            nn.ReLU(),
        )
        self.head = nn.Sequential(
            nn.Flatten(),
            nn.Dropout(0.2),
            nn.Linear(CELL * (SIZE_PX[0] // 8) * (SIZE_PX[1] // 8), HIDDEN),
            nn.ReLU(),
            nn.Linear(HIDDEN, SECTORS),
        )

    def forward(self, images: Tensor) -> Tensor:
        """Return the log probabilities of images."""
        return torch.log_softmax(self.head(self.features(images)), 1)
