"""Scores of one followed person, as in the tools of TPT-Bench."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from common.metrics.counts import Counts
from common.metrics.scores import Row
from people4d.messages import F64

ABSENT = (0.0, 0.0, 0.0, 0.0, -1.0)
LEVELS = 100  # number of thresholds of the confidence
OVERLAPS = (0.01, *(k / 10 for k in range(1, 10)), 0.99)  # minimum overlaps of the recall
Answer = tuple[float, float, float, float, float]  # left, top, width, height, confidence


class TargetTruth(msgspec.Struct, frozen=True):
    """The person in one image."""

    is_exist: bool
    bbox: tuple[float, float, float, float]  # [px] left, top, width, height


@dataclass(frozen=True)
class TargetScores(Counts):
    """Sums over sequences; the tool averages them."""

    sequences: int = 0
    overlap: float = 0.0
    f_score: float = 0.0
    recall: float = 0.0  # mean over OVERLAPS of the largest recall at full precision

    def row(self) -> Row:
        """Return the means."""
        sums = {"ao": self.overlap, "f_score": self.f_score, "max_recall": self.recall}
        return {name: x / self.sequences if self.sequences else None for name, x in sums.items()}


def corners(box: Sequence[float]) -> F64:
    """Return left, top, right and bottom."""
    left, top, width, height = box
    return np.array([left, top, left + width, top + height])


def score(truth: Mapping[str, TargetTruth], answers: Mapping[str, Answer]) -> TargetScores:
    """Score the answers of one sequence."""
    overlaps, confident = [], []
    for time, one in truth.items():
        *box, confidence = answers[time]
        given = confidence != ABSENT[4]
        confident.append(confidence if given else 0.0)
        overlaps.append(
            _overlap(corners(one.bbox), corners(box)) if given and one.is_exist else 0.0
        )
    shown = np.array([one.is_exist for one in truth.values()])
    found, confidences = np.array(overlaps), np.array(confident)
    precision, recall = _curve(found, confidences, int(shown.sum()))
    f_scores = 2 * precision * recall / (precision + recall + 1e-6)
    full = []
    for least in OVERLAPS:
        precise, part = _curve((found >= least).astype(np.float64), confidences, int(shown.sum()))
        full.append(float(part[precise == 1.0].max(initial=-1.0)))
    return TargetScores(1, float(found[shown].mean()), float(f_scores.max()), float(np.mean(full)))


def _curve(values: F64, confidences: F64, total: int) -> tuple[F64, F64]:
    """Return mean value (precision) and sum over the total (recall) above each threshold."""
    falling, count = np.sort(confidences)[::-1], LEVELS - 2
    if len(falling) > count:
        step = len(falling) // count
        falling = falling[np.round(np.linspace(step, len(falling) - step, count)).astype(int)]
    chosen = [confidences >= level for level in (np.inf, *falling, -np.inf)]
    precision = [float(values[one].mean()) if one.any() else 1.0 for one in chosen]
    return np.array(precision), np.array([float(values[one].sum()) / total for one in chosen])


def _overlap(a: F64, b: F64) -> float:
    """Return the overlap of two boxes whose edges count as pixels, as in the tool."""
    width, height = np.maximum(0.0, np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]) + 1)
    areas = [float(np.prod(box[2:] - box[:2] + 1)) for box in (a, b)]
    return float(width * height / (sum(areas) - width * height))
