"""The MOT15 sequences of the reference data: tuning split, and scores."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from common.metrics.scores import Scores, combine
from evaluation.datasets.boxes import BoxSequence
from evaluation.datasets.mot import MOT15

# Tuning split: a moving camera and a static one
TUNING = ("ETH-Bahnhof", "TUD-Stadtmitte")
HELD_OUT = ("ADL-Rundle-6", "KITTI-17", "TUD-Campus")


def load_all(shared: Path) -> dict[str, BoxSequence]:
    """Read the five sequences."""
    MOT15.check_tuning(f"mot15/{name}" for name in TUNING)
    folder = shared / "data" / "mot15"
    return {name: MOT15.load(folder / name) for name in (*TUNING, *HELD_OUT)}


def quality(scores: Iterable[Scores]) -> float:
    """Return the mean over sequences of MOTA + IDF1 + HOTA, the criterion of settings."""
    rows = [one.row() for one in scores]
    return float(np.mean([sum(row[key] or 0 for key in ("mota", "idf1", "hota")) for row in rows]))


def cells(scores: Iterable[Scores]) -> list[str]:
    """Return MOTA, IDF1 and HOTA in percent, and ID switches, of several sequences in total."""
    row = combine(scores).row()
    shares = [f"{100 * (row[key] or 0):.1f}" for key in ("mota", "idf1", "hota")]
    return [*shares, f"{row['id_switches']:.0f}"]
