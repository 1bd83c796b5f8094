"""Protocol of a report, and the comparison of two reports."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from deploy.cli import app
from evaluation.compare import compare_reports, compare_sums
from evaluation.evaluate import evaluate
from evaluation.protocol import commit
from evaluation.report.page import write
from evaluation.report.parts import FIGURES
from people4d.errors import SourceError
from tests.evaluation import builders
from tests.evaluation.test_by_hand import plan, quiet

FRAMES = 80  # 8 s: 8 parts


def report(folder: Path, shift_m: float, x_m: float = 2.0) -> Path:
    """Write the report of a person at x_m, measured at some distance behind."""
    folder.mkdir()
    truths = [builders.truth(k, ann=(x_m, 0.0)) for k in range(FRAMES)]
    noise_m = np.random.default_rng(1).normal(0, 0.01, FRAMES)
    detected = [
        builders.detections(k, (0.0, 0.0, 2.0 + shift_m + noise_m[k])) for k in range(FRAMES)
    ]
    recording = builders.write(folder / "one.mcap", [*truths, *detected])
    planned = plan(recording, folder)
    write(planned, evaluate(planned, quiet), folder / "report", "people4d evaluate")
    return folder / "report"


def test_better_run_is_stated_with_its_interval(tmp_path: Path) -> None:
    """The error falls from 0.3 to 0.1 m; identities are the same."""
    first, second = report(tmp_path / "a", 0.3), report(tmp_path / "b", 0.1)
    (figures,) = compare_reports(first, second).values()
    sentences = {one.difference.figure.title: one.sentence for one in figures}
    assert sentences["position error, m"].startswith("better by 0.20")
    assert sentences["IDF1, points"] == "no difference beyond the interval (0.0 ± 0.0)"
    (worse,) = compare_reports(second, first).values()
    assert any(one.sentence.startswith("worse by 0.20") for one in worse)
    result = CliRunner().invoke(app, ["compare", str(first), str(second)])
    assert result.exit_code == 0, result.stderr
    assert "8 parts" in result.stdout
    assert "better by 0.20" in result.stdout


def test_protocol_states_what_determines_the_figures(tmp_path: Path) -> None:
    protocol = json.loads((report(tmp_path / "a", 0.1) / "protocol.json").read_text())
    assert protocol["command"] == "people4d evaluate"
    assert {"Python", "numpy", "people4d-robot"} <= protocol["versions"].keys()
    assert protocol["commit"] == commit()
    assert protocol["methods"]["seg-sort"]["tracker"]["sort3d"]["t_lost"] == 10
    assert protocol["machine"]["cores"] >= 1
    assert protocol["recordings"]["one"]["frames"] == FRAMES


def test_runs_with_different_truth_are_refused(tmp_path: Path) -> None:
    first, second = report(tmp_path / "a", 0.1), report(tmp_path / "b", 0.1, x_m=2.001)
    result = CliRunner().invoke(app, ["compare", str(first), str(second)])
    assert result.exit_code == 1
    assert "different ground truth of one" in result.stderr
    result = CliRunner().invoke(app, ["compare", str(first), str(tmp_path)])
    assert result.exit_code == 1
    assert "Name the folder of a report" in result.stderr


def test_interval_that_reaches_zero_on_its_longer_side_is_no_difference() -> None:
    """One of 20 parts is 100 m^2 worse: resamples without it are 36 % of all."""
    first = np.ones((20, len(FIGURES), 2))
    second = first.copy()
    second[0, 4, 0] += 100.0
    figure = list(compare_sums(first, second))[4]
    assert not figure.is_worse
    assert figure.sentence.startswith("no difference beyond the interval (1.449 ± ")  # sqrt(6) - 1
    second[:, 4, 0] = 4.0
    assert list(compare_sums(first, second))[4].sentence == "worse by 1.000 ± 0.000"


def test_few_parts_give_no_interval() -> None:
    sums = np.ones((2, len(FIGURES), 2))
    assert {one.sentence for one in compare_sums(sums, sums)} == {"no interval from 2 parts"}


def test_figures_of_parts_add_up_to_the_figures_of_the_run(tmp_path: Path) -> None:
    folder = tmp_path / "a"
    folder.mkdir()
    truths = [builders.truth(k, ann=(2.0, 0.0)) for k in range(FRAMES)]
    detected = [builders.detections(k, (0.0, 0.0, 1.9)) for k in range(20, FRAMES)]
    missing = [builders.detections(k) for k in range(20)]
    recording = builders.write(folder / "one.mcap", [*truths, *missing, *detected])
    done = evaluate(plan(recording, folder), quiet)
    sums, row = done.runs[0].parts.sum(axis=0), done.rows[0]
    assert sums[0, 0] / sums[0, 1] == pytest.approx(row["idf1"])
    assert sums[1, 0] / sums[1, 1] == pytest.approx(row["recall"])
    assert 60 * sums[3, 0] / sums[3, 1] == pytest.approx(row["id_switches_per_min"])


def test_report_with_half_its_parts_is_refused(tmp_path: Path) -> None:
    first, second = report(tmp_path / "a", 0.1), report(tmp_path / "b", 0.1)
    path = second / "parts.csv"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:5]))
    with pytest.raises(SourceError, match="have 8 and 4 parts of seg-sort"):
        compare_reports(first, second)
