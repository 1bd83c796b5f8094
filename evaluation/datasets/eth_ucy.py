"""ETH and UCY pedestrians as OpenTraj distributes them: predictions of positions on the ground.

.../SCENE/obsmat.txt (frame, person, x, z, y, three velocities) and groups.txt
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from common.metrics.counts import Counts, ratio
from common.metrics.scores import Row
from evaluation.datasets.dataset import Dataset, DatasetJob, SequenceResult
from evaluation.datasets.walks import PERIOD_S, predict, read_walks
from evaluation.methods import Method, read_method
from people4d.errors import ConfigError
from people4d.messages import F64
from services.predictor.config import PredictorConfig

OBSERVED, PREDICTED = 8, 12  # annotations of a path, 0.4 s apart, as in published figures


@dataclass(frozen=True)
class DisplacementErrors(Counts):
    """Errors of predicted paths, summed, and of constant velocity on the same paths."""

    paths: int
    ade_m: float  # mean error of a path
    fde_m: float  # mean error at the end of a path
    constant_ade_m: float
    constant_fde_m: float

    def row(self) -> Row:
        """Return all figures by name."""
        names = ("ade_m", "fde_m", "constant_ade_m", "constant_fde_m")
        sums = (self.ade_m, self.fde_m, self.constant_ade_m, self.constant_fde_m)
        row: Row = {"paths": self.paths}
        return row | {n: ratio(total, self.paths) for n, total in zip(names, sums, strict=True)}


@dataclass(frozen=True, kw_only=True)
class PredictionDataset(Dataset):
    """Recorded paths, seen from above."""

    def sequences(self, folder: Path) -> Sequence[str]:
        """Return the scenes."""
        found = sorted(folder.rglob("obsmat.txt"))
        if not found:
            self.require(folder / "ETH" / "seq_eth" / "obsmat.txt")
        self.require(*(path.with_name("groups.txt") for path in found))
        return [str(path.parent.relative_to(folder)) for path in found]

    def methods(self, presets: Sequence[str], settings: Sequence[str]) -> list[Method]:
        """Return the predictor, which has no presets."""
        if presets or settings:
            got = ", ".join([*presets, *settings])
            raise ConfigError(f"{self.title}: expected no preset and no setting, got {got}")
        return [replace(read_method(self.preset), name="predictor")]

    def evaluate(self, job: DatasetJob) -> SequenceResult:
        """Predict each person with eight or more annotations and twelve more to come."""
        walks = read_walks(job.path)
        found = predict(walks, PredictorConfig(step_s=PERIOD_S, steps=PREDICTED))
        truth_m, velocities_mps = walks.followed(found.horizons_s)
        known = np.isfinite(truth_m).all(axis=(1, 2)) & (walks.history() >= OBSERVED)
        rows = [row for row in found.people if known[row]]
        means_m = np.array([found.people[row].means_m for row in rows])
        ahead_m = found.horizons_s[:, None] * velocities_mps[rows, None]
        constant_m = walks.positions_m[rows, None] + ahead_m
        errors = [_errors(paths, truth_m[rows]) for paths in (means_m, constant_m)]
        return SequenceResult(DisplacementErrors(len(rows), *errors[0], *errors[1]))


def _errors(paths_m: F64, truth_m: F64) -> tuple[float, float]:
    """Return the sums of mean and last errors of paths (KxHx2)."""
    errors_m = np.linalg.norm(paths_m.reshape(truth_m.shape) - truth_m, axis=2)
    return float(errors_m.mean(axis=1).sum()), float(errors_m[:, -1].sum())


ETH_UCY = PredictionDataset(
    title="ETH and UCY",
    layout="https://github.com/crowdbotp/OpenTraj",
    licence="free for research",
    obtain="Get the folder datasets of https://github.com/crowdbotp/OpenTraj, and name it.",
    metric="ADE and FDE in metres, 8 annotations seen and 12 predicted, also of constant velocity",
    server="",
    preset="best",
    columns=("paths", "ade_m", "fde_m", "constant_ade_m", "constant_fde_m"),
    tuning=("*seq_hotel", "*zara01"),
)
