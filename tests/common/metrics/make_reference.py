"""Compute the figures of test_parity.py by TrackEval and motmetrics.

They are no dependency of this project: they bring pandas and matplotlib, and motmetrics warns of
what NumPy removed. In an environment of their own, from the root of the repository:

    python -m venv /tmp/reference
    /tmp/reference/bin/pip install trackeval==1.3.0 motmetrics==1.4.0 msgspec
    /tmp/reference/bin/python -m tests.common.metrics.make_reference ../shared/data/mot15 \
        > tests/common/metrics/reference.json

Ground truth and overlaps of MOT15 are read and computed apart from the code under test.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from common.metrics.record import EvaluationSequence
from tests.common.metrics.samples import MOT15, SEEDS, drawn, mot15

CLEAR = ("CLR_TP", "CLR_FN", "CLR_FP", "IDSW", "MT", "PT", "ML", "MOTA", "MOTP", "CLR_Re", "CLR_Pr")
IDENTITY = ("IDTP", "IDFN", "IDFP", "IDF1", "IDP", "IDR")
HOTA = ("HOTA", "DetA", "AssA", "LocA", "DetRe", "DetPr", "AssRe", "AssPr")
MOTMETRICS = (
    *("num_detections", "num_misses", "num_false_positives", "num_switches", "num_fragmentations"),
    *("mostly_tracked", "partially_tracked", "mostly_lost", "mota", "motp", "idf1", "idp", "idr"),
)

Ids = list[np.ndarray]


def mot15_inputs(folder: Path) -> tuple[Ids, Ids, list[np.ndarray]]:
    """Read one MOT15 sequence: ids of truth and tracks, and their overlap, for each frame."""
    from trackeval.datasets import MotChallenge2DBox  # type: ignore[import-not-found] # noqa: PLC0415

    truth = np.loadtxt(folder / "gt" / "gt.txt", delimiter=",")
    truth = truth[truth[:, 6] != 0]
    persons, tracks, overlaps = [], [], []
    for number, frame in enumerate(mot15(folder).frames, start=1):
        rows = truth[truth[:, 0] == number]
        boxes = np.zeros((0, 4)) if not frame.hypotheses.ids else frame.hypotheses.boxes_xyxy_px
        assert boxes is not None
        ltwh = np.hstack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]])
        persons.append(rows[:, 1].astype(int))
        tracks.append(np.array(frame.hypotheses.ids, int))
        overlaps.append(
            MotChallenge2DBox._calculate_box_ious(rows[:, 2:6], ltwh, box_format="xywh")
        )
    return persons, tracks, overlaps


def drawn_inputs(sequence: EvaluationSequence) -> tuple[Ids, Ids, list[np.ndarray]]:
    """Return the same of a drawn sequence, by distance on the ground up to 0.5 m."""
    persons, tracks, alike = [], [], []
    for frame in sequence.frames:
        a, b = frame.truth.positions_m, frame.hypotheses.positions_m
        assert a is not None
        assert b is not None
        distance_m = np.hypot(*(a[:, None, :2] - b[None, :, :2]).transpose(2, 0, 1))
        persons.append(np.array(frame.truth.ids, int))
        tracks.append(np.array(frame.hypotheses.ids, int))
        alike.append(np.maximum(0.0, 1.0 - distance_m / 1.0))
    return persons, tracks, alike


def trackeval_data(persons: Ids, tracks: Ids, alike: list[np.ndarray]) -> dict[str, Any]:
    """Put the inputs into the form of TrackEval's metrics."""
    known, tracked = np.unique(np.concatenate(persons)), np.unique(np.concatenate(tracks))
    return {
        "num_timesteps": len(persons),
        "num_gt_ids": len(known),
        "num_tracker_ids": len(tracked),
        "num_gt_dets": sum(map(len, persons)),
        "num_tracker_dets": sum(map(len, tracks)),
        "gt_ids": [np.searchsorted(known, ids) for ids in persons],
        "tracker_ids": [np.searchsorted(tracked, ids) for ids in tracks],
        "similarity_scores": alike,
    }


def motmetrics_row(persons: Ids, tracks: Ids, alike: list[np.ndarray]) -> dict[str, float]:
    """Ask motmetrics."""
    import motmetrics  # type: ignore[import-not-found] # noqa: PLC0415

    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    for ids, tracked, similarity in zip(persons, tracks, alike, strict=True):
        accumulator.update(ids, tracked, np.where(similarity >= 0.5, 1.0 - similarity, np.nan))
    row = motmetrics.metrics.create().compute(accumulator, metrics=list(MOTMETRICS), name="x")
    return {name: float(row[name].iloc[0]) for name in MOTMETRICS}


def main() -> None:
    """Print all figures as JSON."""
    from trackeval import metrics  # type: ignore[import-not-found] # noqa: PLC0415

    folder = Path(sys.argv[1])
    inputs = {name: mot15_inputs(folder / name) for name in MOT15}
    inputs |= {f"drawn {seed}": drawn_inputs(drawn(seed)) for seed in SEEDS}
    quiet = {"PRINT_CONFIG": False}
    metrics = (
        (metrics.CLEAR(quiet), CLEAR),
        (metrics.Identity(quiet), IDENTITY),
        (metrics.HOTA(), HOTA),
    )
    answers: dict[str, dict[str, Any]] = {name: {} for name in (*inputs, "MOT15", "drawn")}
    for metric, names in metrics:
        parts = {name: metric.eval_sequence(trackeval_data(*x)) for name, x in inputs.items()}
        pools = {"MOT15": MOT15, "drawn": tuple(f"drawn {seed}" for seed in SEEDS)}
        for pool, members in pools.items():
            parts[pool] = metric.combine_sequences({name: parts[name] for name in members})
        for name, part in parts.items():
            answers[name] |= {key: np.asarray(part[key]).tolist() for key in names}
    for name, x in inputs.items():
        answers[name]["motmetrics"] = motmetrics_row(*x)
    lines = (f"{json.dumps(name)}: {json.dumps(rounded(row))}" for name, row in answers.items())
    print("{", ",\n".join(lines), "}", sep="\n")


def rounded(value: Any) -> Any:
    """Keep nine decimals of every number."""
    if isinstance(value, dict):
        return {key: rounded(part) for key, part in value.items()}
    return np.round(value, 9).tolist()


if __name__ == "__main__":
    main()
