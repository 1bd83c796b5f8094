"""people4d evaluate --dataset, from the command to the files."""

import csv
from pathlib import Path

import pytest
from typer.testing import CliRunner

from deploy.cli import app
from tests.evaluation.datasets.mot import write_mot
from tests.evaluation.datasets.people import lab_people


def run(*arguments: object) -> tuple[int, str, str]:
    flags = ["evaluate", *map(str, arguments), "--jobs", "1"]
    result = CliRunner().invoke(app, flags, catch_exceptions=False)
    return result.exit_code, result.stdout, result.stderr


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_scores_and_submission_of_two_methods(tmp_path: Path) -> None:
    folder, out = write_mot(tmp_path / "MOT17"), tmp_path / "out"
    write_mot(folder, name="MOT17-04-FRCNN")
    methods = ("image-sort", "image-sort-dynamic")
    status, output, errors = run(*methods, "--dataset", "mot17", folder, "--out", out)
    assert status == 0, errors
    assert "MOT17: HOTA, MOTA, IDF1 as TrackEval's MotChallenge2DBox" in output
    found = rows(out / "scores.csv")
    train = ["train/MOT17-02-FRCNN", "train/MOT17-04-FRCNN", "all"]
    assert [(row["method"], row["sequence"]) for row in found] == [
        (method, sequence) for method in methods for sequence in train
    ]
    # Both train sequences are the same: all of them together have twice the people.
    people = sum(map(len, lab_people()))
    assert [row["truths"] for row in found[3:]] == [str(people), str(people), str(2 * people)]
    assert {float(row["mota"]) for row in found[3:]} == {1.0}
    for method in methods:
        names = sorted(path.name for path in (out / "submission" / method).iterdir())
        assert names == [f"MOT17-{number}-FRCNN.txt" for number in ("01", "02", "04")]


def test_default_method_of_the_data_set(tmp_path: Path) -> None:
    folder, out = write_mot(tmp_path / "MOT17"), tmp_path / "out"
    assert run("--dataset", "mot17", folder, "--out", out)[0] == 0
    assert {row["method"] for row in rows(out / "scores.csv")} == {"image-sort-dynamic"}


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["image-sort"], "expected either --recordings or --dataset"),
        (["--recordings", "lab:short_walk"], "expected a preset, got none. Choose best, "),
        (["--dataset", "mot99", "."], "data set 'mot99' is unknown"),
        (["--dataset", "mot17", "/none/MOT17"], "/: expected none/MOT17, got "),
        (["--dataset", "mot17", ".", "--seeds", "1"], "--dataset takes no --seeds"),
        (["best", "--dataset", "eth-ucy", "."], "expected no preset and no setting, got best"),
    ],
)
def test_wrong_arguments(arguments: list[str], problem: str) -> None:
    status, _, errors = run(*arguments)
    assert status == 1
    assert problem in errors
    assert "gait-spin" not in errors  # no method of tracking
