"""Search of settings, on small recordings and on the shipped one."""

from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from deploy.cli import app
from evaluation.annotations.marks import MarkedImage, write_marks
from evaluation.compare import compare_sums
from evaluation.methods import read_method
from evaluation.pool import Pool
from evaluation.recordings.recordings import EvaluationRecording, plan_recordings
from evaluation.report.parts import part_sums
from evaluation.run.preparation import EvaluationPlan, runs_of
from evaluation.run.run import execute
from evaluation.tuning import TuningBudget, check_tuning, preset_text, tune_plan, with_settings
from people4d.errors import ConfigError
from tests import DEMO
from tests.evaluation import builders
from tests.evaluation.test_by_hand import quiet

pytestmark = pytest.mark.slow

BUDGET = TuningBudget(minutes=1, candidates=4, seed=3)
GATE = "tracker.sort3d.distance_gate_floor_m=0.5"


def recorded(path: Path) -> EvaluationRecording:
    (found,) = plan_recordings([str(path)], [], "geometry", path.parent)
    return found


def planned(path: Path, *settings: str) -> EvaluationPlan:
    return EvaluationPlan(
        methods=(read_method("seg-sort", settings),),
        recordings=(recorded(path),),
        cache=path.parent,
        figures=False,
    )


def short_visits(path: Path) -> Path:
    """Write 16 s in which another person appears every 0.5 s, 4 m from the last one."""
    rows = [(f"p{k // 5}", 2.0 * (-1) ** (k // 5)) for k in range(160)]
    truths = [builders.truth(k, **{name: (5.0, y)}) for k, (name, y) in enumerate(rows)]
    detected = [builders.detections(k, (-y, 0.0, 5.0)) for k, (_, y) in enumerate(rows)]
    return builders.write(path, [*truths, *detected])


def cluttered(path: Path, every: int) -> Path:
    """Write 16 s of one person, with a false detection elsewhere in every n-th frame."""
    truths = [builders.truth(k, ann=(3.0, 0.0)) for k in range(160)]
    false_m = [(-1.5 + k % 7 / 2, 0.0, 4.5) for k in range(160)]
    detected = [
        builders.detections(k, (0.0, 0.0, 3.0), *([false_m[k]] if k % every == every - 1 else []))
        for k in range(160)
    ]
    return builders.write(path, [*truths, *detected])


def test_quick_confirmation_is_found_where_visits_are_short(tmp_path: Path) -> None:
    """One match confirms visitors of 0.5 s; the preset file gives the same settings."""
    plan = planned(short_visits(tmp_path / "visits.mcap"), GATE)
    shipped = recorded(cluttered(tmp_path / "clean.mcap", every=1000))
    results = [tune_plan(plan, shipped, BUDGET, quiet) for _ in range(2)]
    assert results[0] == results[1]  # the same seed
    assert results[0].is_better
    assert results[0].settings["sort3d.min_hits"] < 3
    assert results[0].gain.sentence.startswith("better by")
    file = tmp_path / "tuned.toml"
    file.write_text(preset_text("seg-sort", results[0], ["made by a test"]))
    found = read_method(str(file)).tracker
    assert found == with_settings(read_method("seg-sort"), results[0].settings).tracker


def test_settings_that_are_worse_on_the_shipped_recording_are_not_chosen(tmp_path: Path) -> None:
    """One match would confirm the clutter, too."""
    plan = planned(short_visits(tmp_path / "visits.mcap"), GATE)
    shipped = recorded(cluttered(tmp_path / "clutter.mcap", every=4))
    result = tune_plan(plan, shipped, BUDGET, quiet)
    assert result.settings.get("sort3d.min_hits", 3) >= 3


@pytest.mark.timeout(300)
def test_first_half_never_lowers_the_second_half_beyond_its_interval(tmp_path: Path) -> None:
    """The shipped recording of simulated people, cut in two."""
    halves = [tmp_path / name for name in ("first.mcap", "second.mcap")]
    for half, span in zip(halves, (("--end", 4.5), ("--start", 4.5)), strict=True):
        arguments = ["cut", DEMO, half, *span]
        assert CliRunner().invoke(app, list(map(str, arguments))).exit_code == 0
    plan = EvaluationPlan(
        methods=(read_method("best", ["camera.stride=2"]),),
        recordings=(recorded(halves[0]),),
        cache=tmp_path,
        figures=False,
    )
    result = tune_plan(plan, recorded(halves[0]), BUDGET, quiet)
    second = replace(plan, recordings=(recorded(halves[1]),))
    with Pool(1, quiet) as pool:
        (run,) = runs_of(second, pool)
    tuned = replace(run, method=with_settings(run.method, result.settings))
    before, after = (part_sums(execute(one).matching) for one in (run, tuned))
    assert not next(compare_sums(before, after)).is_worse


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--minutes", "0"), "--minutes: expected more than 0, got 0"),
        (("--candidates", "1"), "--candidates: expected 2 or more, got 1"),
        (("--minutes", "nan"), "--minutes: expected more than 0, got nan"),
        (("--minutes", "1", "--set", "tracker.max_lost_s=nan"), "settings of the camera only"),
        (("--minutes", "1", "--preset", "bets"), "Did you mean best?"),
        (("--minutes", "1", "--truth", "/none.json"), "/none.json is no file of annotations"),
    ],
)
def test_wrong_input_has_a_clear_error(
    tmp_path: Path, flags: tuple[str, ...], message: str
) -> None:
    arguments = ["tune", str(DEMO), "--out", str(tmp_path / "tuned.toml"), *flags]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert message in result.stderr


def test_seed_beyond_32_bits_is_refused() -> None:
    result = CliRunner().invoke(app, ["tune", str(DEMO), "--seed", str(2**32)])
    assert result.exit_code == 2
    assert "--seed" in result.stderr


def test_recordings_of_the_test_split_are_refused(tmp_path: Path) -> None:
    method, file = read_method("best"), tmp_path / "marks.json"
    write_marks(file, MarkedImage(0, ()), "abc")
    annotated = replace(recorded(DEMO), annotations=file)
    check_tuning(annotated, method)
    file.write_text(file.read_text().replace('"marks"', '"split": "test",\n"marks"'))
    with pytest.raises(ConfigError, match="in the test split"):
        check_tuning(annotated, method)
    (held_out,) = plan_recordings(["lab:four_crossing@22"], [], "colour", tmp_path)
    with pytest.raises(ConfigError, match="in the test split"):
        check_tuning(held_out, method)
