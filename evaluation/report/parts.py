"""Sums of each part of a recording, from which two runs are compared with intervals."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from common.metrics.identity import identity_by_frame
from common.metrics.intervals import PooledFigure
from common.metrics.matching import Matching
from evaluation.report.csv_files import write_csv
from people4d.errors import SourceError
from people4d.messages import F64

PART_S = 1.0  # minimum duration of a part [s]
PARTS_MAX = 20  # maximum number of parts of a recording
FILE = "parts.csv"
FIGURES = (
    PooledFigure("IDF1, points", "{:.1f}", 100.0, higher_is_better=True),
    PooledFigure("people with a track, points", "{:.1f}", 100.0, higher_is_better=True),
    PooledFigure("tracks on people, points", "{:.1f}", 100.0, higher_is_better=True),
    PooledFigure("ID switches a minute", "{:.2f}", 60.0),
    PooledFigure("position error, m", "{:.3f}", root=True),
    PooledFigure("velocity error, m/s", "{:.3f}", root=True),
    PooledFigure("yaw error, degrees", "{:.1f}", float(np.degrees(1.0)), root=True),
)
NAMES = tuple(figure.title.partition(",")[0].replace(" ", "_") for figure in FIGURES)


def part_sums(matching: Matching) -> F64:
    """Return part and total of FIGURES in each part of equal duration (NxFx2)."""
    stamps_s, periods_s = matching.sequence.stamps_s, matching.sequence.periods_s
    duration_s = float(periods_s.sum())
    count = min(max(int(duration_s / PART_S), 1), PARTS_MAX)
    parts = np.minimum(stamps_s * count / max(duration_s, 1e-9), count - 1).astype(np.int64)
    sums = np.zeros((count, len(FIGURES), 2))
    frames = zip(parts, identity_by_frame(matching), matching.frame_scores, periods_s, strict=True)
    for part, (idtp, truths, tracked), score, period_s in frames:
        t = score.totals
        sums[part] += (
            (2 * idtp, truths + tracked),
            (t.matches, t.truths),
            (t.matches, t.matches + t.false_alarms),
            (t.id_switches, period_s),
            (t.position_m2, t.poses),
            (t.velocity_m2ps2, t.velocities),
            (t.yaw_rad2, t.yaws),
        )
    return sums


def write_parts(path: Path, runs: Sequence[tuple[str, str, F64]]) -> None:
    """Write the sums of runs: method, recording and sums each."""
    header = ["method", "recording", "part", *(f"{n}_{k}" for n in NAMES for k in ("sum", "of"))]
    rows = (
        [method, recording, part, *values.ravel().tolist()]
        for method, recording, sums in runs
        for part, values in enumerate(sums)
    )
    write_csv(path, header, rows)


def read_parts(path: Path) -> dict[tuple[str, str], F64]:
    """Return the sums of each method and recording; SourceError if the file is unusable."""
    found: dict[tuple[str, str], list[list[float]]] = {}
    try:
        with path.open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                values = [float(row[f"{name}_{kind}"]) for name in NAMES for kind in ("sum", "of")]
                found.setdefault((row["method"], row["recording"]), []).append(values)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise SourceError(
            f"{path} cannot be read: {error!r:.200}",
            "Name the folder of a report of people4d evaluate of this version.",
        ) from error
    return {run: np.array(rows).reshape(-1, len(FIGURES), 2) for run, rows in found.items()}
