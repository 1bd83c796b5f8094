"""people4d csv: truth and tracks as a table, and back again."""

import csv
import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from common.io.people_table import NAMES
from common.io.recording import RecordingWriter
from deploy.cli import app
from people4d.messages import Message, PersonSkeleton, Skeletons
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.registry import open_truth
from tests.gt_bridge.scene import MS, person, track, tracks, truth


def record(folder: Path, *messages: Message) -> Path:
    with RecordingWriter(folder / "x.mcap") as writer:
        for message in messages:
            writer.write(message, message.stamp_ns)
    return folder / "x.mcap"


def run(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["csv", *map(str, arguments)])
    return result.exit_code, result.stdout + result.stderr


def rows_of(file: Path) -> list[dict[str, str]]:
    with file.open(newline="", encoding="utf-8") as text:
        return list(csv.DictReader(text))


def example(folder: Path) -> Path:
    return record(
        folder,
        truth(1000, person("anna", 1.0, 2.0, vx=0.5, yaw_deg=90), person("ben", 3.0, 4.0)),
        tracks(1010, track(7, 1.1, 2.2, vx=0.25, lost=True)),
        truth(1020, person("anna", 1.5, 2.0, vx=0.5, yaw_deg=90)),
    )


def test_rows_match_hand_worked_values(tmp_path: Path) -> None:
    status, output = run(example(tmp_path), tmp_path / "x.csv")
    assert (status, output.split()[:3]) == (0, ["Wrote", "4", "rows"])
    anna, ben, seven, later = rows_of(tmp_path / "x.csv")
    assert tuple(anna) == NAMES
    assert [row["time_s"] for row in (anna, ben, seven, later)] == ["0.0", "0.0", "0.01", "0.02"]
    assert (anna["kind"], anna["id"], anna["stamp_ns"]) == ("truth", "anna", str(1000 * MS))
    assert (anna["x_m"], anna["vx_mps"], anna["yaw_rad"]) == ("1.0", "0.5", "1.5707963267948966")
    assert (ben["vx_mps"], ben["yaw_rad"], ben["state"], ben["camera"]) == ("", "", "", "")
    assert (seven["kind"], seven["id"], seven["state"]) == ("track", "7", "lost")
    assert (seven["unseen_s"], seven["score"], seven["hits"]) == ("0.1", "0.5", "5")
    assert (seven["age"], seven["camera"], seven["frame_id"]) == ("6", "front", "map")


def sitting(stamp_ms: int, id_: int) -> Skeletons:
    person = PersonSkeleton(
        id=id_,
        state="confirmed",
        positions_m=np.zeros((17, 3), np.float32),
        covariances_m2=np.tile(np.eye(3, dtype=np.float32), (17, 1, 1)),
        measured=(True,) * 17,
        posture="sitting",
        posture_probability=0.75,
        stature_m=1.75,
        stature_sigma_m=0.0625,
        child=0.25,
        object_like=0.5,
    )
    return Skeletons(
        stamp_ns=stamp_ms * MS, sequence=0, frame_id="map", camera="front", people=(person,)
    )


def test_posture_and_stature_of_a_track_are_from_skeletons_of_its_frame(tmp_path: Path) -> None:
    frames = (tracks(at, track(7, 1.0, 2.0), track(8, 3.0, 2.0)) for at in (1000, 1033))
    file = record(tmp_path, *frames, sitting(1000, 7), sitting(1040, 8))
    run(file, tmp_path / "x.csv")
    found = [list(row.values())[-6:] for row in rows_of(tmp_path / "x.csv")]
    assert found == [["sitting", "0.75", "1.75", "0.0625", "0.25", "0.5"], *[[""] * 6] * 3]


def test_truth_at_the_stamps_of_the_tracks(tmp_path: Path) -> None:
    run(example(tmp_path), tmp_path / "x.csv", "--at-tracks")
    anna, seven = rows_of(tmp_path / "x.csv")  # ben is absent at 1020 ms, so unknown between
    assert (anna["kind"], anna["stamp_ns"]) == ("truth", seven["stamp_ns"])
    assert float(anna["x_m"]) == 1.25  # half-way from 1.0 to 1.5


def test_the_table_reads_back_as_truth(tmp_path: Path) -> None:
    run(example(tmp_path), tmp_path / "x.csv")
    got = list(open_truth(GtBridgeConfig(truth=str(tmp_path / "x.csv"))))
    want = list(open_truth(GtBridgeConfig(truth=str(example(tmp_path)))))
    assert len(got) == len(want) == 2
    for one, other in zip(got, want, strict=True):
        assert (one.stamp_ns, one.frame_id) == (other.stamp_ns, other.frame_id)
        for a, b in zip(one.people, other.people, strict=True):
            assert (a.id, a.yaw_rad) == (b.id, b.yaw_rad)
            assert a.position_m.tolist() == b.position_m.tolist()
            assert (a.velocity_mps is None) == (b.velocity_mps is None)


def test_truth_of_another_file_with_an_offset(tmp_path: Path) -> None:
    recording = record(tmp_path, tracks(1010, track(7, 1.1, 2.2)))
    other = tmp_path / "vicon.csv"
    other.write_text("stamp_ns,id,x_m,y_m,z_m\n10000000,anna,1,2,3\n")
    run(recording, tmp_path / "x.csv", "--truth", other, "--offset", "1.0")
    anna, seven = rows_of(tmp_path / "x.csv")
    assert (anna["id"], anna["stamp_ns"], seven["id"]) == ("anna", str(1010 * MS), "7")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("x.xlsx", "has an unsupported format. Write .csv or .parquet."),
        (f"{'x' * 300}.csv", "cannot be written"),
        ("b/x.csv", "b does not exist"),
    ],
)
def test_errors_are_one_sentence(name: str, message: str, tmp_path: Path) -> None:
    status, output = run(example(tmp_path), tmp_path / name)
    assert status == 1
    assert message in output
    assert not (tmp_path / "b").exists()


def test_recording_without_people_is_reported(tmp_path: Path) -> None:
    status, output = run(record(tmp_path, tracks(0)), tmp_path / "x.csv")
    assert status == 1
    assert "has neither truth nor tracks. It holds people." in output


def test_parquet_without_pyarrow_fails_with_a_hint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)  # as if it were not installed
    status, output = run(example(tmp_path), tmp_path / "x.parquet")
    assert status == 1
    assert "-m pip install 'people4d-robot[parquet]'" in output


@pytest.mark.skipif(importlib.util.find_spec("pyarrow") is None, reason="pyarrow is not installed")
def test_parquet_holds_what_csv_holds(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    run(example(tmp_path), tmp_path / "x.csv")
    run(example(tmp_path), tmp_path / "x.parquet")
    table = parquet.read_table(tmp_path / "x.parquet")
    assert tuple(table.column_names) == NAMES
    assert table.schema.field("x_m").metadata == {b"meaning": b"[m] position: torso"}
    for got, want in zip(table.to_pylist(), rows_of(tmp_path / "x.csv"), strict=True):
        assert {k: "" if v is None else str(v) for k, v in got.items()} == want


def test_table_of_damaged_truth_is_not_left_by_half(tmp_path: Path) -> None:
    file = tmp_path / "truth.csv"
    file.write_text("stamp_ns,id,x_m,y_m,z_m\n1,a,1,2,3\n2,a,1,2,up\n")
    table = tmp_path / "x.csv"
    table.write_text("as before")
    status, output = run(example(tmp_path), table, "--truth", file)
    assert (status, "line 3: z_m" in output) == (1, True)
    assert table.read_text() == "as before"
    assert not list(tmp_path.glob(".*"))
