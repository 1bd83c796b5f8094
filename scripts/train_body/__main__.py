"""Train the body network on rendered candidates: `python -m scripts.train_body DATA`.

It runs in an environment of its own, see README.md; the result is models/body-lab.onnx.
"""

import copy
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import torch  # type: ignore[import-not-found]
from torch import Tensor, nn

from scripts.render_bodies.labels import PERSON_MIN, Kind
from scripts.train_body.losses import estimates, loss, normalised
from scripts.train_body.network import CHANNELS, SIZE_PX, BodyNetwork
from scripts.train_body.samples import Batch, Samples
from scripts.train_embedding.training import arguments, export, optimise

OUTPUT = Path(__file__).resolve().parents[2] / "models" / "body-lab.onnx"
VALIDATION = ("014", "015", "-08", "-09")  # ends of the names of files that are not learned
BOXES = ""  # content of files of drawn boxes, without detections
# Numbers of samples of a batch by content
BATCH = {BOXES: 192, "people": 22, "furniture": 15, "robot": 14, "screen": 7, "poster": 6}
DECAY = 2e-3
GRADIENT_MAX = 5.0
AVERAGED = 0.998  # decay of the averaged weights
RECALL = 0.95
VISIBLE, MOSTLY_VISIBLE = 0.3, 0.5  # minimum visible shares of people in figures
CHI_SQUARE_90 = 4.605  # 90 % quantile of the squared normalised error, two axes


def average(mean: nn.Module, network: nn.Module, step: int) -> None:
    """Update the exponential mean of the weights; the first steps are soon forgotten."""
    decay = min(AVERAGED, step / (step + 20))
    for old, new in zip(mean.state_dict().values(), network.state_dict().values(), strict=True):
        if old.dtype.is_floating_point:
            old.lerp_(new, 1 - decay)
        else:
            old.copy_(new)


def read_samples(folder: Path, held: bool) -> dict[str, Samples]:
    """Return the samples to learn, or those held back to validate, by content."""
    files = defaultdict[str, list[Path]](list)
    for path in sorted(folder.glob("*.npz")):
        if path.stem.endswith(VALIDATION) == held:
            files[path.stem.rpartition("-")[0]].append(path)
    return {content: Samples.read(paths) for content, paths in files.items()}


def draw_batch(samples: Mapping[str, Samples]) -> Batch:
    """Draw augmented samples of each content."""
    drawn = [
        samples[content].augmented(torch.randint(0, len(samples[content].kinds), (count,)))
        for content, count in BATCH.items()
    ]
    return Batch(*map(torch.cat, zip(*drawn, strict=True)))


def predict(network: nn.Module, samples: Samples) -> Tensor:
    """Return the outputs for samples as they are."""
    network.eval()
    with torch.no_grad():
        batches = [samples.batch(chosen) for chosen in torch.arange(len(samples.kinds)).split(256)]
        outputs = torch.cat([network(batch.images) for batch in batches])
    network.train()
    return outputs


def rejected(network: nn.Module, samples: Samples) -> float:
    """Return the share of samples below the tracker's minimum of people."""
    return float((predict(network, samples)[:, 0] < PERSON_MIN).float().mean())


def validate(network: nn.Module, samples: Samples) -> str:
    """Return figures on samples as they are: people against other things, and positions."""
    outputs = predict(network, samples)
    person = samples.kinds == Kind.PERSON
    score = outputs[:, 0]
    limit = score[person & (samples.shares > VISIBLE)].quantile(1 - RECALL)
    false = ", ".join(
        f"{(score[samples.kinds == kind] > limit).float().mean():.1%} {kind.title}"
        for kind in Kind
        if kind != Kind.PERSON and (samples.kinds == kind).any()
    )
    estimate = estimates(outputs[person])
    offsets_m = samples.offsets_m[person]
    errors_m = (estimate.offsets_m - offsets_m)[samples.shares[person] > MOSTLY_VISIBLE]
    right, down, along = errors_m.square().mean(0).sqrt().tolist()
    inside = normalised(estimate, offsets_m).square().sum(1) < CHI_SQUARE_90
    return (
        f"area under the curve {area_under_curve(score, person):.4f}\n"
        f"false at {RECALL:.0%} recall: {false}\n"
        f"RMSE {right:.4f} m across, {along:.4f} m along, {down:.4f} m down, "
        f"{inside.float().mean():.1%} in the 90 % ellipse"
    )


def area_under_curve(score: Tensor, positive: Tensor) -> float:
    """Return the probability that a positive sample has a higher score than a negative one."""
    ordered = positive[score.argsort()]
    below = (~ordered).cumsum(0)[ordered]
    return float(below.double().mean() / (~positive).sum())


def main() -> None:
    """Train, validate and export the averaged network."""
    flags = arguments(__doc__.splitlines()[0], 6000, OUTPUT)
    samples, validation = (read_samples(flags.data, held) for held in (False, True))
    for name, found in (*samples.items(), *validation.items()):
        print(f"{len(found.kinds)} {name or 'boxes'}", flush=True)
    boxes = validation.pop(BOXES)
    network = BodyNetwork()
    mean = copy.deepcopy(network)

    def loss_of_batch() -> Tensor:
        batch = draw_batch(samples)
        return loss(network(batch.images), batch)

    for step in optimise(network, loss_of_batch, flags.steps, DECAY, GRADIENT_MAX):
        average(mean, network, step)
        if step % 500 == 0 or step == flags.steps:
            shares = (f"{rejected(mean, found):.1%} {name}" for name, found in validation.items())
            print(f"{validate(mean, boxes)}\nrejected: {', '.join(shares)}", flush=True)
            export(mean, flags.output, (CHANNELS, *SIZE_PX), "body")


if __name__ == "__main__":
    main()
