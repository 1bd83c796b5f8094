"""Several sequences together, repetitions, and what must hold for any input."""

import math

import numpy as np
import pytest

from common.metrics.record import EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses
from common.metrics.scores import Scores, SummaryStatistics, combine, score, summarise
from common.metrics.similarity import GroundDistance
from tests.common.metrics.samples import SEEDS, drawn
from tests.common.metrics.worlds import sequence

NEAR = GroundDistance(0.5)
IDEAL = (
    *("mota", "motp", "recall", "precision", "idf1", "idp", "idr", "coverage"),
    *("hota", "det_a", "ass_a"),
)


def with_frames(recording: EvaluationSequence, *frames: EvaluationFrame) -> EvaluationSequence:
    return EvaluationSequence(recording.name, frames)


def changed(frame: EvaluationFrame, truth: GroundTruth, tracked: Hypotheses) -> EvaluationFrame:
    return EvaluationFrame(stamp_ns=frame.stamp_ns, truth=truth, hypotheses=tracked)


def assert_same(a: Scores, b: Scores) -> None:
    ours, theirs = a.row(), b.row()
    assert ours.keys() == theirs.keys()
    for name, value in theirs.items():
        assert ours[name] == (None if value is None else pytest.approx(value, abs=1e-9)), name


def test_sequences_are_pooled_not_averaged() -> None:
    # One person missed once: MOTA 0. One person found nine times: MOTA 1. Pooled: 9/10, not 1/2.
    bad, good = sequence(({"A": 0}, {})), sequence(*[({"A": 0}, {1: 0})] * 9)
    both = combine([score(bad, NEAR), score(good, NEAR)])
    assert both.clear.mota == pytest.approx(0.9)
    assert both.clear.recall == 0.9
    # IDF1 = 18 / (18 + 1); the A of one sequence is not the A of the other.
    assert both.identity.idf1 == pytest.approx(18 / 19)
    assert both.lifetimes.people == 2
    assert both.row()["poses"] == 9


def test_pooling_minutes() -> None:
    # One switch in 1 s and none in 3 s: 1 in 4 s = 15 a minute.
    switch = sequence(({"A": 0}, {1: 0}), ({"A": 0}, {2: 0}))
    calm = sequence(*[({"A": 0}, {1: 0})] * 6)
    both = combine([score(switch, NEAR), score(calm, NEAR)])
    assert both.id_switches_per_min == pytest.approx(15.0)


def test_association_is_pooled_by_matches() -> None:
    # AssA 1/2 over four matches and 1 over two: (4 x 1/2 + 2 x 1) / 6 = 2/3.
    torn = sequence(*[({"A": 0}, {1: 0})] * 2, *[({"A": 0}, {2: 0})] * 2)
    complete = sequence(*[({"A": 0}, {1: 0})] * 2)
    both = combine([score(torn, NEAR), score(complete, NEAR)])
    assert both.hota.ass_a == pytest.approx(np.full(19, 2 / 3))


def test_order_of_sequences_does_not_matter() -> None:
    parts = [score(drawn(seed), NEAR) for seed in SEEDS]
    assert_same(combine(parts), combine(reversed(parts)))


@pytest.mark.parametrize("seed", SEEDS)
def test_names_do_not_matter(seed: int) -> None:
    recording = drawn(seed)
    renamed = with_frames(
        recording,
        *(
            changed(
                frame,
                GroundTruth(
                    ids=tuple(f"person {9 - int(i)}" for i in frame.truth.ids),
                    positions_m=frame.truth.positions_m,
                ),
                Hypotheses(
                    ids=tuple(999 - int(i) for i in frame.hypotheses.ids),
                    positions_m=frame.hypotheses.positions_m,
                ),
            )
            for frame in recording.frames
        ),
    )
    assert_same(score(renamed, NEAR), score(recording, NEAR))


@pytest.mark.parametrize("seed", SEEDS)
def test_order_within_a_frame_does_not_matter(seed: int) -> None:
    recording, random = drawn(seed), np.random.default_rng(seed)

    def shuffled(frame: EvaluationFrame) -> EvaluationFrame:
        a, b = frame.truth, frame.hypotheses
        assert a.positions_m is not None
        assert b.positions_m is not None
        i, j = random.permutation(len(a.ids)), random.permutation(len(b.ids))
        return changed(
            frame,
            GroundTruth(ids=tuple(a.ids[k] for k in i), positions_m=a.positions_m[i]),
            Hypotheses(ids=tuple(b.ids[k] for k in j), positions_m=b.positions_m[j]),
        )

    assert_same(
        score(with_frames(recording, *map(shuffled, recording.frames)), NEAR),
        score(recording, NEAR),
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_a_tracker_equal_to_the_truth_is_perfect(seed: int) -> None:
    recording = drawn(seed)
    perfect = with_frames(
        recording,
        *(
            changed(
                frame,
                frame.truth,
                Hypotheses(ids=frame.truth.ids, positions_m=frame.truth.positions_m),
            )
            for frame in recording.frames
        ),
    )
    row = score(perfect, NEAR).row()
    assert {name: row[name] for name in IDEAL} == pytest.approx(dict.fromkeys(IDEAL, 1.0))
    for name in (
        "misses",
        "false_alarms",
        "id_switches",
        "position_rmse_x_m",
        "mean_first_track_s",
    ):
        assert row[name] == 0, name


@pytest.mark.parametrize(
    ("recording", "expected"),
    [
        (EvaluationSequence("no frames", ()), 0.0),
        (sequence(({}, {}), ({}, {})), 0.0),
        (sequence(({"A": 0}, {})), 0.0),
        (sequence(({}, {1: 0})), 0.0),
    ],
)
def test_no_people_or_no_tracks_have_defined_metrics(
    recording: EvaluationSequence, expected: float
) -> None:
    result = score(recording, NEAR)
    row = result.row()
    assert all(value is None or math.isfinite(value) for value in row.values())
    for name in ("mota", "idf1", "hota", "recall", "precision", "id_switches_per_min"):
        assert row[name] == expected, name
    assert row["mean_segment_s"] is None
    assert row["yaw_correlation"] is None
    assert_same(combine([result]), result)


def test_no_sequences_at_all() -> None:
    assert combine([]).row() == score(EvaluationSequence("no frames", ()), NEAR).row()


def test_mean_and_spread() -> None:
    # 1, 2, 6: mean 3, deviations -2, -1, 3: sqrt(14 / 2).
    rows: list[dict[str, float | None]] = [
        {"idf1": 1.0, "yaw": None},
        {"idf1": 2.0, "yaw": 4.0},
        {"idf1": 6.0, "yaw": None},
    ]
    summary = summarise(rows)
    assert summary["idf1"] == SummaryStatistics(3.0, 7**0.5, 1.0, 6.0, 3)
    assert summary["yaw"] == SummaryStatistics(4.0, 0.0, 4.0, 4.0, 1)
    assert summarise([{"yaw": None}]) == {"yaw": None}
    assert summarise([]) == {}
