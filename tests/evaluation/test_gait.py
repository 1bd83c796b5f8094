"""people4d gait on the shipped recording, and the tables of a walk by hand."""

import csv
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from deploy.cli import app
from deploy.launcher.plan import COMPOSE_FILE
from evaluation.gait.run import tracking_nodes
from evaluation.gait.tables import POINT_FIELDS, GaitTables
from evaluation.methods import read_method
from evaluation.pipeline import lockstep, play
from people4d.messages import BodyPoint, GaitMeasures, PersonGait, Tracks
from services.camera.config import CameraConfig
from services.gait.cascade import GaitEstimate
from services.gait.estimator import GaitResult
from tests.gait.steps.test_steps import feet

DEMO = COMPOSE_FILE.parent / "demo" / "crossing.mcap"
BOX = "203,90,295,372"  # of the person in the middle, in the first frame
NAMES = {"head", "left_hand", "right_hand", "left_foot", "right_foot"}


def run(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["gait", *map(str, arguments)])
    return result.exit_code, result.stdout + result.stderr


def rows_of(file: Path) -> list[dict[str, str]]:
    with file.open(newline="", encoding="utf-8") as text:
        return list(csv.DictReader(text))


@pytest.mark.slow
def test_people_are_tracked_by_appearance() -> None:
    nodes = tracking_nodes(read_method(""))
    camera = CameraConfig(source=str(DEMO), max_frames=3)
    messages = [one for step in play(lockstep(camera), nodes) for one in step.messages]
    counters = nodes[-1].status().counters
    assert sum(isinstance(one, Tracks) for one in messages) == 3
    assert counters["without_embeddings"] == counters["late_embeddings"] == 0


@pytest.mark.slow
def test_all_people_are_detected_and_tracked(tmp_path: Path) -> None:
    out = tmp_path / "out"
    status, output = run(DEMO, "--out", out, "--set", "camera.max_frames=4")
    assert status == 0, output
    rows = rows_of(out / "gait.csv")
    assert tuple(rows[0]) == POINT_FIELDS
    # Three people are in view from the first frame; tracks are confirmed in the second frame.
    assert len({row["person"] for row in rows}) == 3
    assert {row["point"] for row in rows} == NAMES
    head = [row for row in rows if row["point"] == "head"]
    assert all(0.8 < float(row["z_m"]) < 2.0 for row in head)
    assert len({row["time_s"] for row in rows}) == 3
    assert [row["person"] for row in rows_of(out / "measures.csv")] == sorted(
        {row["person"] for row in rows}
    )
    assert rows_of(out / "steps.csv") == []
    assert {len(list(out.glob(f"person_*.{kind}"))) for kind in ("trc", "c3d", "bvh")} == {3}
    video = cv2.VideoCapture(os.fspath(out / "gait.webm"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 4
    assert cv2.imread(os.fspath(out / "frames.png")) is not None


@pytest.mark.slow
def test_box_is_tracked_by_colour(tmp_path: Path) -> None:
    out = tmp_path / "out"
    settings = ("--set", "camera.max_frames=4", "--no-video")
    status, output = run(DEMO, "--person", BOX, "--out", out, *settings)
    assert status == 0, output
    rows = rows_of(out / "gait.csv")
    assert {row["person"] for row in rows} == {"1"}
    assert len({row["time_s"] for row in rows}) == 4
    # The people stand 4.4 m in front of the camera, half a metre to its left.
    (head, *_) = (row for row in rows if row["point"] == "head")
    assert float(head["x_m"]) == pytest.approx(4.37, abs=0.3)
    assert not (out / "gait.webm").exists()
    assert cv2.imread(os.fspath(out / "frames.png")) is not None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("none.mcap",), "source 'none.mcap' does not exist"),
        ((DEMO, "--person", "me"), "is neither auto nor a box"),
        ((DEMO, "--person", "9,9,5,20"), "the box has no area"),
        ((DEMO, "--person", "700,10,800,200"), "no person is in that box of the first frame"),
        ((DEMO, "--set", "gait.nothing=1"), "nothing"),
        ((DEMO, "--set", "gait.people_max=0"), "people_max"),
        ((DEMO, "--set", "unknown.field=1"), "unknown"),
        ((DEMO, "--preset", "nonesuch"), "unknown preset 'nonesuch'"),
    ],
)
def test_invalid_arguments_give_an_error(
    tmp_path: Path, arguments: tuple[str | Path, ...], message: str
) -> None:
    status, output = run(*arguments, "--out", tmp_path, "--set", "camera.max_frames=2")
    assert (status, message in " ".join(output.split())) == (1, True), output


def test_tables_by_hand(tmp_path: Path) -> None:
    # Steps of 0.6 m in 0.5 s, the right foot first: 120 a minute; left feet land at 1, 2, ... s.
    log, times_s = GaitTables(), np.arange(0, 5, 1 / 30)
    names = ("left_foot", "right_foot", "head")
    for time_s, *positions in zip(times_s, *feet(times_s), strict=True):
        points = tuple(
            BodyPoint(
                name=name,
                state="measured",
                position_m=position,
                velocity_mps=np.zeros(3),
                covariance=np.diag([0.02, 0.01, 0.03, 1.0, 1.0, 1.0]) ** 2,
                confidence=0.5,
            )
            for name, position in zip(names, (*positions, sum(positions) / 2), strict=True)
        )
        person = PersonGait(id=4, points=points, measures=GaitMeasures())
        log.add_frame(
            7_000_000_000 + round(time_s * 1e9), [GaitResult(GaitEstimate(4, None, {}), person)]
        )
    log.write(tmp_path)
    first = rows_of(tmp_path / "gait.csv")[0]
    assert (first["time_s"], first["person"], first["point"]) == ("0", "4", "left_foot")
    sigmas = [first[f"sigma_{axis}_m"] for axis in "xyz"]
    assert (first["confidence"], sigmas) == ("0.5", ["0.02", "0.01", "0.03"])
    (estimate,) = rows_of(tmp_path / "measures.csv")
    assert float(estimate["cadence_per_min"]) == pytest.approx(120, abs=1)
    assert float(estimate["step_length_m"]) == pytest.approx(0.6, abs=0.01)
    steps = rows_of(tmp_path / "steps.csv")
    left = [float(step["landed_s"]) for step in steps if step["foot"] == "left"]
    assert left == pytest.approx([1.0, 2.0, 3.0, 4.0], abs=0.05)
    assert {step["observed"] for step in steps} == {"1"}
    assert all(0.3 <= float(step["confidence"]) <= 1 for step in steps)
