"""The same figures as TrackEval and motmetrics (reference.json, made by make_reference.py)."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from common.metrics.clear import count_clear
from common.metrics.matching import Matching, match
from common.metrics.record import FrameMatches
from common.metrics.scores import Scores, combine, score_matching
from common.metrics.similarity import GroundDistance, box_overlap
from tests.common.metrics.samples import MOT15, SEEDS, drawn, mot15

DRAWN = tuple(f"drawn {seed}" for seed in SEEDS)
REFERENCE: dict[str, dict[str, Any]] = json.loads(
    (Path(__file__).parent / "reference.json").read_text()
)


@cache
def matched_mot15(folder: Path) -> Matching:
    return match(mot15(folder), box_overlap)


@pytest.fixture(params=MOT15 + DRAWN)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def matching(name: str, request: pytest.FixtureRequest) -> Matching:
    if name in DRAWN:
        return matched_drawn(name)
    return matched_mot15(request.getfixturevalue("shared") / "data" / "mot15" / name)


def matched_drawn(name: str) -> Matching:
    return match(drawn(int(name.split()[1])), GroundDistance(0.5))


def under_trackevals_names(scores: Scores) -> dict[str, Any]:
    c, i, h = scores.clear, scores.identity, scores.hota
    row: dict[str, Any] = {"CLR_TP": c.matches, "CLR_FN": c.misses, "CLR_FP": c.false_alarms}
    row |= {"IDSW": c.id_switches, "MOTA": c.mota, "MOTP": c.motp}
    row |= {"CLR_Re": c.recall, "CLR_Pr": c.precision}
    row |= {"IDTP": i.idtp, "IDFN": i.idfn, "IDFP": i.idfp}
    row |= {"IDF1": i.idf1, "IDP": i.idp, "IDR": i.idr}
    return row | {"HOTA": h.hota, "DetA": h.det_a, "AssA": h.ass_a}


def assert_like_trackeval(scores: Scores, name: str) -> None:
    for key, value in under_trackevals_names(scores).items():  # of HOTA for 19 thresholds
        assert np.asarray(value) == pytest.approx(np.array(REFERENCE[name][key]), abs=1e-8), key


@pytest.mark.slow
def test_trackeval(name: str, matching: Matching) -> None:
    assert_like_trackeval(score_matching(matching), name)


def test_trackeval_pooled() -> None:
    assert_like_trackeval(combine(score_matching(matched_drawn(name)) for name in DRAWN), "drawn")


@pytest.mark.slow
def test_trackeval_pooled_mot15(shared: Path) -> None:
    folders = (shared / "data" / "mot15" / name for name in MOT15)
    assert_like_trackeval(combine(score_matching(matched_mot15(f)) for f in folders), "MOT15")


def test_motmetrics_identity(name: str, matching: Matching) -> None:
    identity, theirs = score_matching(matching).identity, REFERENCE[name]["motmetrics"]
    for key in ("idf1", "idp", "idr"):
        assert getattr(identity, key) == pytest.approx(theirs[key], abs=1e-8)


def test_motmetrics_clear(name: str, matching: Matching) -> None:
    # motmetrics keeps the last track of a person forever, even if the track has been another
    # person's since. TrackEval and this project keep pairs of the previous frame only. Given the
    # pairs of motmetrics, the counts are equal.
    matching = persistent(matching)
    counts, theirs = count_clear(matching), REFERENCE[name]["motmetrics"]
    assert counts.matches == theirs["num_detections"]
    assert counts.misses == theirs["num_misses"]
    assert counts.false_alarms == theirs["num_false_positives"]
    assert counts.id_switches == theirs["num_switches"]
    assert counts.mota == pytest.approx(theirs["mota"], abs=1e-8)
    assert counts.motp == pytest.approx(1.0 - theirs["motp"], abs=1e-8)  # there a mean distance


def persistent(matching: Matching) -> Matching:
    """Match again by the rule of motmetrics."""
    last = dict.fromkeys(range(len(matching.persons)), -1)
    steps = []
    for step in matching.frame_matches:
        stored = np.zeros(step.similarity.shape, np.bool_)
        for row, person in enumerate(step.persons.tolist()):
            for column in np.flatnonzero(step.tracks == last[person]):
                stored[row, column] = (
                    step.similarity[row, column] >= 0.5 and not stored[:, column].any()
                )
        steps.append(rematched(step, stored))
        pairs = zip(steps[-1].rows, steps[-1].columns, strict=True)
        last |= {int(step.persons[i]): int(step.tracks[j]) for i, j in pairs}
    return replace(matching, frame_matches=tuple(steps))


def rematched(step: FrameMatches, stored: np.ndarray) -> FrameMatches:
    worth = np.where(step.similarity >= 0.5, 1000.0 * stored + 1.0 + step.similarity, 0.0)
    rows, columns = linear_sum_assignment(worth, maximize=True)
    valid = worth[rows, columns] > 0
    return replace(step, rows=rows[valid], columns=columns[valid])
