"""The body network: is a candidate a person, and where is the middle of the torso."""

from torch import Tensor, nn  # type: ignore[import-not-found]

from scripts.train_embedding.network import grid_features, grid_head

SIZE_PX = (48, 32)  # [px] height and width of the input
CHANNELS = 7  # red, green, blue, mask, relative depth, relief, readings
OUTPUTS = 9  # see `BodyNetwork`
FEATURES = (24, 48, 64)  # numbers of features, from fine to coarse
CELL = 32  # number of features of each of the 6x4 cells
HIDDEN = 96


class BodyNetwork(nn.Module):  # type: ignore[misc]
    """Nx7x48x32 (colour, mask and depth) to Nx9 values.

    They are the logit of a person, the logit of the visible share, the offset of the torso to the
    right and along the line of sight, the Cholesky factor of its covariance (first, both, second),
    the offset downward and its standard deviation.
    """

    def __init__(self) -> None:
        super().__init__()
        self.features = grid_features(CHANNELS, FEATURES, CELL)
        self.head = grid_head(CELL, SIZE_PX, HIDDEN, OUTPUTS)

    def forward(self, images: Tensor) -> Tensor:
        """Return the outputs for images."""
        return self.head(self.features(images))
