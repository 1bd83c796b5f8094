"""Train the orientation network on rendered crops: `python -m scripts.train_orientation DATA`.

It runs in an environment of its own, see README.md; the result is models/orientation-lab.onnx.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch  # type: ignore[import-not-found]
from torch import Tensor
from torch.nn import functional  # type: ignore[import-not-found]

from scripts.train_embedding.augment import RGB, blurred, lit, occluded, other_background, with_mask
from scripts.train_embedding.training import (
    SHARED_SCENE,
    arguments,
    export,
    on_device,
    optimise,
)
from scripts.train_orientation.network import SECTORS, SIZE_PX, OrientationNetwork

OUTPUT = Path(__file__).resolve().parents[2] / "models" / "orientation-lab.onnx"
BATCH = 512
DECAY = 1e-3
SIGMA_RAD = math.radians(10)  # [rad] standard deviation of the labels
INPUT = 2 / 3  # ratio of the sides of the network's input and of stored crops
SHOULDERS = -1 / 11  # row of the shoulders in both, from -1 to 1
TESTED = 10  # number of files with one test file


@dataclass(frozen=True)
class Crops:
    """Rendered crops."""

    images: Tensor  # Nx6xHxW bytes, see scripts/render_people
    scenes: np.ndarray  # N numbers
    yaws_rad: Tensor  # [rad] N

    @classmethod
    def read(cls, paths: Sequence[Path]) -> "Crops":
        """Read files."""
        images, scenes, yaws_rad = [], [], []
        for k, path in enumerate(paths):
            with np.load(path) as file:
                images.append(file["upper_bodies"].transpose(0, 3, 1, 2))
                scenes.append(file["upper_owners"] // SHARED_SCENE + 1000 * k)
                yaws_rad.append(file["yaws_rad"])
        yaws = on_device(np.concatenate(yaws_rad)).float()
        return cls(on_device(np.concatenate(images)), np.concatenate(scenes), yaws)

    def augmented(self, chosen: np.ndarray) -> tuple[Tensor, Tensor]:
        """Return augmented crops as input of the network, and their yaws."""
        scenes = on_device(np.unique(self.scenes[chosen], return_inverse=True)[1])
        mirrored = torch.rand(len(chosen)) < 0.5
        images = moved(self.images[chosen].float() / 255, mirrored)
        images = occluded(other_background(images))
        rgb = blurred(lit(images[:, RGB], scenes))
        yaws_rad = self.yaws_rad[chosen]
        inputs = with_mask(torch.cat([rgb, images[:, 3:]], 1))
        return inputs, torch.where(mirrored, -yaws_rad, yaws_rad)


def moved(images: Tensor, mirrored: Tensor) -> Tensor:
    """Return images of the network's size, with errors of keypoints and depths."""
    count = len(images)
    theta = torch.zeros(count, 2, 3)
    turn = torch.randn(count) * 0.06
    scale = INPUT * torch.exp(torch.randn(count, 1) * 0.08 + torch.randn(count, 2) * 0.04)
    theta[:, 0, 0] = torch.where(mirrored, -1.0, 1.0) * scale[:, 0]
    theta[:, 1, 1] = scale[:, 1]
    theta[:, 0, 1], theta[:, 1, 0] = turn, -turn
    theta[:, :, 2] = torch.randn(count, 2) * 0.06
    theta[:, 1, 2] += SHOULDERS * (1 - INPUT)
    grid = functional.affine_grid(theta, [*images.shape[:2], *SIZE_PX], align_corners=False)
    return functional.grid_sample(images, grid, padding_mode="border", align_corners=False)


def wrap(angles_rad: Tensor) -> Tensor:
    """Return angles from -pi to pi."""
    return torch.remainder(angles_rad + math.pi, 2 * math.pi) - math.pi


def labels(yaws_rad: Tensor) -> Tensor:
    """Return probabilities of the sectors, NxSECTORS, of normally distributed yaws."""
    middles = torch.arange(SECTORS) * (2 * math.pi / SECTORS)
    off = wrap(middles - yaws_rad[:, None])
    return torch.softmax(-((off / SIGMA_RAD) ** 2) / 2, 1)


def test(network: OrientationNetwork, crops: Crops) -> str:
    """Return the errors on augmented crops of the test files."""
    network.eval()
    off, losses = [], []
    with torch.no_grad():
        for chosen in np.array_split(np.arange(len(crops.images)), len(crops.images) // 256 + 1):
            inputs, yaws_rad = crops.augmented(chosen)
            log_p = network(inputs)
            losses.append(-(labels(yaws_rad) * log_p).sum(1))
            off.append(wrap(log_p.argmax(1) * (2 * math.pi / SECTORS) - yaws_rad).abs())
    network.train()
    deg = torch.rad2deg(torch.cat(off))
    far = ", ".join(f"more than {most}: {(deg > most).float().mean():.1%}" for most in (45, 90))
    return f"loss {torch.cat(losses).mean():.3f}, median {deg.median():.1f} degrees, {far}"


def main() -> None:
    """Train, test and export."""
    flags = arguments(__doc__.splitlines()[0], 14600, OUTPUT)
    rng = np.random.default_rng(flags.seed)
    paths = sorted(flags.data.glob("*.npz"))
    tested = Crops.read(paths[::TESTED])
    crops = Crops.read([path for k, path in enumerate(paths) if k % TESTED])
    print(f"{len(crops.images)} crops of {len(np.unique(crops.scenes))} scenes", flush=True)
    network = OrientationNetwork()

    def loss_of_batch() -> Tensor:
        inputs, yaws_rad = crops.augmented(rng.choice(len(crops.images), BATCH, replace=False))
        return -(labels(yaws_rad) * network(inputs)).sum(1).mean()

    for step in optimise(network, loss_of_batch, flags.steps, DECAY):
        if step % 1000 == 0:
            print(test(network, tested), flush=True)
    export(network, flags.output, (4, *SIZE_PX), "log_probabilities")


if __name__ == "__main__":
    main()
