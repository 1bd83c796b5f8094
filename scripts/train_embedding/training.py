"""Command line, optimisation and export of networks for images of people."""

import argparse
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import torch  # type: ignore[import-not-found]
from torch import Tensor, nn

RATE = 2e-3
SHARED_SCENE = 6  # number of identities of a scene, PEOPLE in scripts/render_people


def arguments(description: str, steps: int, output: Path) -> argparse.Namespace:
    """Read the command line; set seed, device and one thread of torch."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("data", type=Path, help="folder of the rendered files")
    parser.add_argument("--steps", type=int, default=steps)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, default=output, help="default: %(default)s")
    parser.add_argument("--device", default="cpu", help="for example cuda")
    flags = parser.parse_args()
    torch.set_num_threads(1)
    torch.set_default_device(flags.device)
    torch.manual_seed(flags.seed)
    return flags


def on_device(values: np.ndarray) -> Tensor:
    """Return an array as a tensor on the default device."""
    return torch.from_numpy(values).to(torch.get_default_device())


def optimise(
    network: nn.Module,
    loss_of_batch: Callable[[], Tensor],
    steps: int,
    decay: float,
    gradient_max: float = math.inf,
) -> Iterator[int]:
    """Train a network; yield the number of each step, from 1, and print the loss.

    Args:
        network: Network to train.
        loss_of_batch: Returns the loss of a new batch.
        steps: Number of steps, over which the rate rises and falls.
        decay: Decay of the weights.
        gradient_max: Maximum norm of the gradient.
    """
    optimiser = torch.optim.AdamW(network.parameters(), RATE, weight_decay=decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, steps + 1, pct_start=0.1)
    total = 0.0
    for step in range(1, steps + 1):
        loss = loss_of_batch()
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), gradient_max)
        optimiser.step()
        schedule.step()
        total += loss.item()
        if step % 50 == 0:
            print(f"{step}: loss {total / 50:.3f}, {time.process_time():.0f} s", flush=True)
            total = 0.0
        yield step


def export(network: nn.Module, path: Path, shape: tuple[int, int, int], output: str) -> None:
    """Write a network of images (N and a shape, CxHxW) as ONNX, with the name of its output."""
    network.eval()
    torch.onnx.export(
        network,
        (torch.zeros(1, *shape),),
        str(path),
        input_names=["images"],
        output_names=[output],
        dynamic_axes={"images": {0: "N"}, output: {0: "N"}},
        opset_version=17,
        dynamo=False,
    )
    network.train()
