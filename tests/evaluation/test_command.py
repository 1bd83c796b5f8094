"""people4d evaluate, from the command to the report."""

import csv
import re
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from common.io.recording import open_recording
from deploy.cli import app
from deploy.cli.system.demo import DEMO
from tests.lab.scenarios import write_scenario

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("evaluate")]

METHODS = ("seg-sort", "pose-strongsort-movenet")
TABLES = (
    *("6_1_id_switches", "6_2_position", "6_3_velocity", "6_4_orientation"),
    *("tracking", "apart_measured", "apart_predicted", "apart_occluded"),
)


def run(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["evaluate", *map(str, arguments)], catch_exceptions=False)
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two methods on two short scenarios, one with two seeds, with one job and with two."""
    folder = tmp_path_factory.mktemp("evaluate")
    walk, stroll = (f"lab:{write_scenario(folder, name=name)}" for name in ("walk", "stroll"))
    flags = ["--fidelity", "geometry", "--seeds", "1,2", "--cache", folder / "cache"]
    flags += ["--recordings", f"{walk},{stroll}@3"]
    for jobs, drawn in ((1, "--figures"), (2, "--no-figures")):
        out = folder / f"jobs{jobs}"
        status, output, errors = run(*METHODS, *flags, "--jobs", jobs, drawn, "--out", out)
        assert status == 0, errors
        (out / "terminal.txt").write_text(output)
        (out / "errors.txt").write_text(errors)
    return folder


def test_the_number_of_jobs_changes_no_byte(folder: Path) -> None:
    same = sorted(path.relative_to(folder / "jobs1") for path in folder.glob("jobs1/**/*.csv"))
    assert len(same) == 4 + len(TABLES)
    for path in same:
        assert (folder / "jobs1" / path).read_bytes() == (folder / "jobs2" / path).read_bytes()


def test_geometry_warns_of_what_it_cannot_give(folder: Path) -> None:
    warning = "--fidelity geometry has no appearance: "
    assert f"Warning: {warning}" in (folder / "jobs1" / "errors.txt").read_text()
    report = (folder / "jobs1" / "report.html").read_text()
    assert f'<p class="warning">{warning}' in report
    assert "walk@1, walk@2, stroll@3 has no images" in report


def test_every_run_has_a_row(folder: Path) -> None:
    with (folder / "jobs1" / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["method"], row["recording"], row["scenario"]) for row in rows] == [
        (method, f"{scene}@{seed}", scene)
        for method in METHODS
        for scene, seed in (("walk", 1), ("walk", 2), ("stroll", 3))
    ]
    assert {row["people_in_truth"] for row in rows} == {"2"}
    assert all(float(row["poses"]) > 0 for row in rows)
    with (folder / "jobs1" / "summary.csv").open() as file:
        switches = [r for r in csv.DictReader(file) if r["metric"] == "id_switches_per_min"]
    assert [(row["method"], row["people"], row["runs"]) for row in switches] == [
        (method, people, "3") for method in METHODS for people in ("all", "2")
    ]


def test_the_report_needs_no_other_file_and_has_every_table(folder: Path) -> None:
    text = (folder / "jobs1" / "report.html").read_text()
    sources = re.findall(r"(?:src|href)=\"([^\"]*)\"", text)
    assert len(sources) > 5
    assert all(source.startswith(("data:image/", "#")) for source in sources)
    assert "http" not in re.sub(r"base64,[^\"]*", "", text)
    assert "@import" not in text
    for table in TABLES:
        assert f'id="{table}"' in text
        assert (folder / "jobs1" / "tables" / f"{table}.csv").is_file()
    # Published results, in rows marked as such.
    assert re.search(
        r'<tr class="published"><td>published: YOLOv8s-seg \+ SORT-3D</td><td>4</td><td>17.20', text
    )
    assert text.count("data:image/png") == 1 + 2 * 2  # errors; each scenario once


def test_the_terminal_shows_the_overview(folder: Path) -> None:
    text = (folder / "jobs1" / "terminal.txt").read_text()
    assert "8.60" in text
    assert f"Wrote {folder / 'jobs1' / 'report.html'}" in text.replace("\n", "")


def test_people_are_found_once_for_all_trackers(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    flags = ("--recordings", DEMO, "--cache", cache, "--jobs", 1, "--set", "camera.max_frames=6")
    status, _, errors = run(
        "pose-strongsort-movenet", *flags, "--out", tmp_path / "a", "--no-figures"
    )
    assert status == 0, errors
    (found,) = (cache / "detections").glob("*.mcap")
    (vectors,) = (cache / "embeddings").glob("*.mcap")
    assert open_recording(found).summary.topics["detections/front"] == 6
    assert open_recording(vectors).summary.topics["embeddings/front"] == 6
    made = found.stat().st_mtime_ns, vectors.stat().st_mtime_ns
    other = tmp_path / "motion.toml"  # another tracker on the same detections and embeddings
    other.write_text('extends = "pose-strongsort-movenet"\n[tracker.strongsort3d]\nn_init = 1\n')
    status, _, errors = run(
        "pose-strongsort-movenet", other, *flags, "--out", tmp_path / "b", "--no-figures"
    )
    assert status == 0, errors
    assert (found.stat().st_mtime_ns, vectors.stat().st_mtime_ns) == made
    assert len(list(cache.rglob("*.mcap"))) == 2
    with (tmp_path / "b" / "runs.csv").open() as file:
        first, second = csv.DictReader(file)
    assert float(second["coverage"]) > float(first["coverage"])
    assert (tmp_path / "b" / "tables" / "6_5_speed.csv").is_file()
    assert not (tmp_path / "b" / "figures").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["seg-sot", "--recordings", "lab:walk"], "Did you mean seg-sort?"),
        (["seg-sort", "--recordings", "lab:nothing"], "unknown scenario nothing"),
        (["seg-sort", "--recordings", "/none.mcap"], "'/none.mcap' does not exist"),
        (
            ["seg-sort", "--recordings", "lab:short_walk", "--seeds", "x"],
            "expected comma-separated whole numbers",
        ),
        (
            ["seg-sort", "--recordings", "lab:short_walk", "--set", "detector.model=yolov9"],
            "model 'yolov9' is unknown",
        ),
        (["seg-sort", "seg-sort", "--recordings", "lab:short_walk"], "seg-sort is repeated"),
        (
            ["seg-sort", "--recordings", "lab:short_walk", "--recordings", "lab:short_walk@42"],
            "short_walk@42 is repeated",
        ),
        (
            ["seg-sort", "--recordings", "lab:short_walk", "--set", "report.video=false"],
            "'report.video=false' names no running service",
        ),
    ],
)
def test_errors_are_one_sentence_with_a_hint(arguments: list[str], message: str) -> None:
    status, _, errors = run(*arguments)
    assert status == 1
    assert message in errors
    assert "Traceback" not in errors


def test_without_matplotlib_the_report_has_no_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)  # what Python does to hide a module
    scenario = f"lab:{write_scenario(tmp_path, name='walk')}"
    flags = ("--recordings", scenario, "--fidelity", "geometry", "--cache", tmp_path / "cache")
    out = tmp_path / "out"
    status, output, errors = run("seg-sort", *flags, "--jobs", 1, "--out", out)
    assert status == 0, errors
    assert "No figures: matplotlib is not installed" in output
    assert (out / "report.html").is_file()
    assert not (out / "figures").exists()
