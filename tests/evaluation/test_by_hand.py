"""A small recording with figures worked by hand."""

import csv
from pathlib import Path

import pytest

from evaluation.evaluate import RunReport, evaluate
from evaluation.methods import read_method
from evaluation.recordings.recordings import plan_recordings
from evaluation.report.page import write
from evaluation.run.preparation import EvaluationPlan
from people4d.errors import SourceError
from tests.evaluation import builders

FRAMES = 60
LEFT, BACK = 20, 50  # the person is not detected from frame 20 to 49


def quiet(what: str, share: float) -> None:
    pass


def plan(path: Path, folder: Path, *settings: str) -> EvaluationPlan:
    """Plan the first method of [PIC4SeR], in which one person needs no distance gate."""
    rules = ("tracker.sort3d.distance_gate_floor_m=100", "tracker.sort3d.t_lost=10", *settings)
    return EvaluationPlan(
        methods=(read_method("seg-sort", rules),),
        recordings=tuple(plan_recordings([str(path)], [], "geometry", folder)),
        cache=folder,
        figures=False,
    )


@pytest.fixture
def away(tmp_path: Path) -> Path:
    """Recording of a person at (2, 0), measured 0.1 m too near, and undetected for 3 s."""
    detected = [
        builders.detections(k, *([] if LEFT <= k < BACK else [(0.0, 0.0, 1.9)]))
        for k in range(FRAMES)
    ]
    truths = [builders.truth(k, ann=(2.0, 0.0)) for k in range(FRAMES)]
    return builders.write(tmp_path / "away.mcap", [*truths, *detected])


def only(planned: EvaluationPlan) -> tuple[RunReport, dict[str, float | None]]:
    done = evaluate(planned, quiet)
    assert len(done.runs) == 1
    return done.runs[0], dict(done.rows[0])


def test_figures_by_hand(away: Path, tmp_path: Path) -> None:
    # 60 frames at 10 Hz are 6 s. SORT-3D confirms with the third match: ID 1 is in frames
    # 2 to 19 and ID 2 in 52 to 59: 18 + 8 = 26 of 60 frames, one ID switch in 6 s = 10 a minute,
    # two segments of 2.6 s / 2 = 1.3 s. The person is first tracked at frame 2 = 0.2 s.
    run, row = only(plan(away, tmp_path))
    assert run.switches == (("seg-sort", "away", "ann", 1, 2, 1.9, 5.2),)
    assert row["id_switches_per_min"] == pytest.approx(10.0)
    assert row["truths"] == 60
    assert row["coverage"] == pytest.approx(26 / 60)
    assert row["mean_segment_s"] == pytest.approx(1.3)
    assert row["mean_first_track_s"] == pytest.approx(0.2)
    assert row["mota"] == pytest.approx((60 - 34 - 1) / 60)
    # All 26 poses are 0.1 m too near, along the camera's axis.
    assert row["poses"] == 26
    assert row["position_rmse_along_m"] == pytest.approx(0.1, abs=1e-6)
    assert row["position_rmse_across_m"] == pytest.approx(0.0, abs=1e-6)
    assert row["position_within_0.15_m"] == 1.0
    assert row["velocity_rmse_along_mps"] == pytest.approx(0.0, abs=1e-6)


def test_a_person_out_of_view_is_no_miss(tmp_path: Path) -> None:
    # 640 px of 600 px focal length: at 3 m the image reaches from -1.6 to 1.6 m; depth to 5 m.
    truths = [builders.truth(k, ann=(3.0, 0.0), bea=(3.0, 1.7), eve=(5.1, 0.0)) for k in range(10)]
    detected = [builders.detections(k, (0.0, 0.0, 3.0)) for k in range(10)]
    _, row = only(plan(builders.write(tmp_path / "view.mcap", [*truths, *detected]), tmp_path))
    assert row["truths"] == 10
    assert row["misses"] == 2  # before ann is confirmed
    assert row["people"] == 1


def test_a_person_not_captured_is_neither_miss_nor_false_alarm(tmp_path: Path) -> None:
    # Motion capture loses bea from frame 5 to 14, but her track continues.
    truths = [
        builders.truth(k, ann=(3.0, 0.5), **({} if 5 <= k < 15 else {"bea": (3.0, -0.5)}))
        for k in range(20)
    ]
    detected = [builders.detections(k, (-0.5, 0.0, 3.0), (0.5, 0.0, 3.0)) for k in range(20)]
    _, row = only(plan(builders.write(tmp_path / "gap.mcap", [*truths, *detected]), tmp_path))
    assert row["truths"] == 20 + 10
    assert row["misses"] == 2 + 2
    assert row["false_alarms"] == 0


def test_frames_without_any_truth_are_left_out(tmp_path: Path) -> None:
    truths = [builders.truth(k, ann=(3.0, 0.0)) for k in range(10, 20)]
    detected = [builders.detections(k, (0.0, 0.0, 3.0)) for k in range(30)]
    run, row = only(plan(builders.write(tmp_path / "late.mcap", [*truths, *detected]), tmp_path))
    assert (row["truths"], row["misses"], row["false_alarms"]) == (10, 0, 0)
    assert row["duration_s"] == pytest.approx(1.0)
    assert run.scores.frames == 30


def test_the_switch_is_in_the_table_and_the_report(away: Path, tmp_path: Path) -> None:
    planned = plan(away, tmp_path)
    page = write(planned, evaluate(planned, quiet), tmp_path / "out", "people4d evaluate <it>")
    with (tmp_path / "out" / "tables" / "6_1_id_switches.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[0] == {
        "method": "seg-sort", "source": "measured", "people": "all", "ID switches/min": "10.00",
    }  # fmt: skip
    assert {row["ID switches/min"] for row in rows if row["source"] == "published"} >= {
        "8.60",
        "17.20",
    }
    text = page.read_text()
    assert "Person ann was ID 1 until 1.90 s and is ID 2 from 5.20 s on." in text
    assert "people4d evaluate &lt;it&gt;" in text


@pytest.mark.parametrize("frame_id", ["map", "hall"])
def test_truth_and_tracks_must_share_a_frame(frame_id: str, tmp_path: Path) -> None:
    truths, detected = (
        [builders.truth(0, ann=(2.0, 0.0))],
        [builders.detections(0, (0.0, 0.0, 2.0))],
    )
    path = builders.write(tmp_path / "frames.mcap", [*truths, *detected], frame_id)
    if frame_id == "map":
        evaluate(plan(path, tmp_path), quiet)
    else:
        with pytest.raises(SourceError, match=r"truth of .* is in frame 'map', tracks in 'hall'"):
            evaluate(plan(path, tmp_path, "tracker.frame_id=hall"), quiet)


def test_a_recording_without_truth_is_refused(tmp_path: Path) -> None:
    path = builders.write(tmp_path / "none.mcap", [builders.detections(0, (0.0, 0.0, 2.0))])
    with pytest.raises(SourceError, match=r"none.mcap holds no truth"):
        evaluate(plan(path, tmp_path), quiet)
