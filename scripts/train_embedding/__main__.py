"""Train the appearance network on rendered crops: `python -m scripts.train_embedding DATA`.

It runs in an environment of its own, see README.md; the result is models/appearance-lab.onnx.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch  # type: ignore[import-not-found]
from torch import Tensor

from scripts.train_embedding.augment import augment
from scripts.train_embedding.network import HEIGHT_PX, WIDTH_PX, AppearanceNetwork
from scripts.train_embedding.training import SHARED_SCENE, arguments, export, on_device, optimise

OUTPUT = Path(__file__).resolve().parents[2] / "models" / "appearance-lab.onnx"
SCENES, CROPS = 16, 4  # numbers of scenes in a batch, and of crops of each person
TEMPERATURE = 0.1
DECAY = 1e-4


def read_crops(folder: Path) -> tuple[Tensor, list[np.ndarray]]:
    """Return all crops (Nx6xHxW bytes), and their indices by scene and person."""
    crops, owned, first = [], [], 0
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as file:
            crops.append(file["bodies"].transpose(0, 3, 1, 2))
            owners = file["owners"]
        people = SHARED_SCENE * (int(owners.max()) // SHARED_SCENE + 1)
        owned += [first + np.flatnonzero(owners == person) for person in range(people)]
        first += len(owners)
    return on_device(np.concatenate(crops)), owned


def batch(owned: Sequence[np.ndarray], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw indices of crops and their people, from few scenes with similar people."""
    scenes = rng.choice(len(owned) // SHARED_SCENE, SCENES, replace=False)
    people = (scenes[:, None] * SHARED_SCENE + np.arange(SHARED_SCENE)).ravel()
    enough = [person for person in people.tolist() if len(owned[person]) >= CROPS]
    chosen = [rng.choice(owned[person], CROPS, replace=False) for person in enough]
    return np.concatenate(chosen), np.repeat(enough, CROPS)


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
    flags = arguments(__doc__.splitlines()[0], 11600, OUTPUT)
    rng = np.random.default_rng(flags.seed)
    crops, owned = read_crops(flags.data)
    print(f"{len(crops)} crops of {len(owned)} people", flush=True)
    network = AppearanceNetwork()

    def loss_of_batch() -> Tensor:
        numbers, people = batch(owned, rng)
        person, scene = (
            on_device(np.unique(groups, return_inverse=True)[1])
            for groups in (people, people // SHARED_SCENE)
        )
        return contrastive_loss(network(augment(crops[numbers], person, scene)), person)

    for _ in optimise(network, loss_of_batch, flags.steps, DECAY):
        pass
    export(network, flags.output, (4, HEIGHT_PX, WIDTH_PX), "vectors")


if __name__ == "__main__":
    main()
