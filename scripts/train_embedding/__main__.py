"""Train the appearance network on rendered crops: `python -m scripts.train_embedding DATA`.

It runs in an environment of its own, see README.md; the result is models/appearance-lab.onnx.
"""

from pathlib import Path

import numpy as np
import torch  # type: ignore[import-not-found]
from torch import Tensor

from scripts.train_embedding.augment import augment
from scripts.train_embedding.network import HEIGHT_PX, WIDTH_PX, AppearanceNetwork
from scripts.train_embedding.training import SHARED_SCENE, arguments, export, optimise

OUTPUT = Path(__file__).resolve().parents[2] / "models" / "appearance-lab.onnx"
SCENES, CROPS = 6, 4  # in a batch: scenes, and crops of each of their people
TEMPERATURE = 0.1
DECAY = 1e-4


def read_crops(folder: Path) -> tuple[Tensor, np.ndarray]:
    """Return all crops (Nx6xHxW bytes) and their owners (N)."""
    crops, owners, first = [], [], 0
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as file:
            crops.append(file["crops"].transpose(0, 3, 1, 2))
            owners.append(file["owners"] + first)
            first += SHARED_SCENE * (int(file["owners"].max()) // SHARED_SCENE + 1)
    return torch.from_numpy(np.concatenate(crops)), np.concatenate(owners)


def batches(owners: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw indices of crops and their owners: people of some scenes, who are hard to tell apart."""
    scenes = rng.choice(owners.max() // SHARED_SCENE + 1, SCENES, replace=False)
    chosen = []
    for person in (scenes[:, None] * SHARED_SCENE + np.arange(SHARED_SCENE)).ravel():
        own = np.flatnonzero(owners == person)
        if len(own) >= CROPS:
            chosen.append(rng.choice(own, CROPS, replace=False))
    indices = np.concatenate(chosen)
    return indices, owners[indices]


def contrastive_loss(vectors: Tensor, owners: Tensor) -> Tensor:
    """Return the supervised contrastive loss [Khosla 2020]."""
    logits = vectors @ vectors.T / TEMPERATURE
    self_pairs = torch.eye(len(vectors), dtype=torch.bool)
    logits = logits.masked_fill(self_pairs, -1e9)
    log_share = logits - logits.logsumexp(1, keepdim=True)
    same = (owners[:, None] == owners[None]) & ~self_pairs
    return -(log_share * same).sum(1).div(same.sum(1)).mean()


def main() -> None:
    """Train and export."""
    flags = arguments(__doc__.splitlines()[0], 2200, OUTPUT)
    rng = np.random.default_rng(flags.seed)
    crops, owners = read_crops(flags.data)
    print(f"{len(crops)} crops of {len(np.unique(owners))} people", flush=True)
    network = AppearanceNetwork()

    def loss_of_batch() -> Tensor:
        indices, people = batches(owners, rng)
        number, scene = (
            torch.from_numpy(np.unique(groups, return_inverse=True)[1])
            for groups in (people, people // SHARED_SCENE)
        )
        return contrastive_loss(network(augment(crops[indices], number, scene)), number)

    for _ in optimise(network, loss_of_batch, flags.steps, DECAY):
        pass
    export(network, flags.output, (HEIGHT_PX, WIDTH_PX), "vectors")


if __name__ == "__main__":
    main()
