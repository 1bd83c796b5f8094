"""The appearance network: colour and texture, pooled over visible parts of the person."""

import torch  # type: ignore[import-not-found]
from torch import Tensor, nn

HEIGHT_PX, WIDTH_PX = 64, 32  # [px] size of the input
DIMENSION = 128
STEM = 24  # number of features of the first layer
PARTS = 8  # number of attention maps
COLOURS = 48  # number of soft bins of colour
COARSE, FINE = 96, 48  # numbers of features
OUTSIDE = 4.0  # logit subtracted outside of the mask


def convolution(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    """Return a 3x3 convolution with normalisation and activation."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU()
    )


class Residual(nn.Module):  # type: ignore[misc]
    """Two convolutions with a skip connection."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = convolution(channels, channels)
        self.second = nn.Sequential(
            nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels)
        )

    def forward(self, images: Tensor) -> Tensor:
        """Return features of the same shape."""
        return torch.relu(images + self.second(self.first(images)))


def grid_features(channels: int, numbers: tuple[int, int, int], cell: int) -> nn.Sequential:
    """Return layers from an image to a grid of an eighth of its size.

    Args:
        channels: Number of channels of the image.
        numbers: Numbers of features of the layers, from fine to coarse.
        cell: Number of features of each cell of the grid.
    """
    fine, middle, coarse = numbers
    return nn.Sequential(
        convolution(channels, fine, 2),
        convolution(fine, middle, 2),
        Residual(middle),
        convolution(middle, coarse, 2),
        Residual(coarse),
        nn.Conv2d(coarse, cell, 1),
        nn.ReLU(),
    )


def grid_head(cell: int, size_px: tuple[int, int], hidden: int, outputs: int) -> nn.Sequential:
    """Return layers from the grid of `grid_features` to outputs.

    Args:
        cell: Number of features of each cell of the grid.
        size_px: Height and width of the image.
        hidden: Number of hidden features.
        outputs: Number of outputs.
    """
    return nn.Sequential(
        nn.Flatten(),
        nn.Dropout(0.2),
        nn.Linear(cell * (size_px[0] // 8) * (size_px[1] // 8), hidden),
        nn.ReLU(),
        nn.Linear(hidden, outputs),
    )


class AppearanceNetwork(nn.Module):  # type: ignore[misc]
    """Nx4x64x32 (RGB and mask, 0 to 1) to Nx128 of unit length."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = convolution(4, STEM, 2)
        self.fine = nn.Sequential(convolution(STEM, FINE, 2), Residual(FINE))
        self.coarse = nn.Sequential(convolution(FINE, COARSE, 2), Residual(COARSE))
        self.attention = nn.Conv2d(FINE + COARSE, PARTS, 1)
        self.colour = nn.Sequential(
            nn.AvgPool2d(2),
            nn.Conv2d(4, 24, 1),
            nn.ReLU(),
            nn.Conv2d(24, COLOURS, 1),
            nn.ReLU(),
            nn.AvgPool2d(2),
        )
        width = PARTS * (COLOURS + FINE + COARSE)
        self.head = nn.Sequential(
            nn.BatchNorm1d(width),
            nn.Linear(width, DIMENSION, bias=False),
            nn.BatchNorm1d(DIMENSION),
        )

    def forward(self, images: Tensor) -> Tensor:
        """Return the vectors of images."""
        fine = self.fine(self.stem(images))
        coarse = nn.functional.interpolate(self.coarse(fine), scale_factor=2.0, mode="nearest")
        both = torch.cat([fine, coarse], 1)
        outside = 1 - nn.functional.avg_pool2d(images[:, 3:], 4)
        attention = (self.attention(both) - OUTSIDE * outside).flatten(2).softmax(2)
        features = torch.cat([self.colour(images), both], 1).flatten(2)
        pooled = attention @ features.transpose(1, 2)
        vectors = self.head(pooled.flatten(1))
        return vectors / vectors.norm(dim=1, keepdim=True).clamp_min(1e-6)
