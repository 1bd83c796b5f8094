"""Truth from MOT text and CSV."""

import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from people4d.errors import SourceError
from people4d.messages import Truth
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.playback import TruthPlayback
from services.gt_bridge.sources.registry import open_truth

SEQINFO = """[Sequence]
name=x
frameRate=25
seqLength=3
imWidth=640
imHeight=480
"""


def read(path: Path, **settings: Any) -> list[Truth]:
    return list(open_truth(GtBridgeConfig(truth=str(path), **settings)))


def mot(folder: Path, text: str, info: str = SEQINFO) -> Path:
    (folder / "gt").mkdir()
    (folder / "gt" / "gt.txt").write_text(text)
    if info:
        (folder / "seqinfo.ini").write_text(info)
    return folder / "gt" / "gt.txt"


def test_mot_text_with_positions(tmp_path: Path) -> None:
    # Frame 3 at 25 Hz is at 80 ms; frame 2 is empty; id 9 is not evaluated, 4 and 5 are nowhere.
    path = mot(
        tmp_path,
        "1,7,10,20,30,40,1,1.5,-2.5,0\n"
        "3,7,10,20,30,40,1,2.5,-2.5,0.25\n"
        "3,4,10,20,30,40,1,-1,-1,-1\n"
        "3,5,10,20,30,40,1,nan,nan,nan\n"
        "3,9,10,20,30,40,0,1,1,0\n",
    )
    got = read(path)
    assert [m.stamp_ns for m in got] == [0, 40_000_000, 80_000_000]
    assert [[p.id for p in m.people] for m in got] == [["7"], [], ["7"]]
    assert got[2].people[0].position_m.tolist() == [2.5, -2.5, 0.25]
    assert got[0].frame_id == "map"
    assert got[0].people[0].velocity_mps is None


def test_mot_text_without_positions_is_refused(tmp_path: Path) -> None:
    path = mot(tmp_path, "1,7,10,20,30,40,1,-1,-1,-1\n2,7,10,20,30,40,1\n")
    with pytest.raises(SourceError, match=r"no position of a person, only boxes.*x, y, z in metr"):
        read(path)


def test_mot_text_needs_a_rate(tmp_path: Path) -> None:
    path = mot(tmp_path, "11,7,10,20,30,40,1,1,2,0\n", info="")
    with pytest.raises(SourceError, match=r"rate is not known\. Set rate_hz"):
        read(path)
    assert read(path, rate_hz=10.0)[-1].stamp_ns == 10**9


def test_damaged_mot_text_is_reported_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="line 2: expected frame,id"):
        read(mot(tmp_path, "1,7,10,20,30,40,1,1,2,0\n1,8,x,20,30,40,1,1,2,0\n"))


def test_mot15_with_positions(shared: Path) -> None:
    got = read(shared / "data/mot15/ETH-Bahnhof/gt/gt.txt")
    assert len(got) > 900
    assert got[1].stamp_ns == pytest.approx(1e9 / 14, abs=1)  # 14 frames a second
    with pytest.raises(SourceError, match="only boxes"):
        read(shared / "data/mot15/ADL-Rundle-6/gt/gt.txt")


def csv(folder: Path, text: str) -> Path:
    (folder / "truth.csv").write_text(text)
    return folder / "truth.csv"


def test_csv_by_hand(tmp_path: Path) -> None:
    path = csv(
        tmp_path,
        "kind,stamp_ns,frame_id,id,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps,yaw_rad\n"
        "truth,1000000000000000001,lab,anna,1,2,3,0.5,0,0,-3\n"
        "truth,1000000000000000001,lab,ben,4,5,6,,,,\n"
        "track,1000000000000000001,map,7,9,9,9,,,,\n"
        "truth,1000000000000000002,lab,anna,1,2,4,0.5,0,,\n",
    )
    first, second = read(path)
    assert first.stamp_ns == 1000000000000000001  # a float would lose the last digits
    assert first.frame_id == "lab"
    anna, ben = first.people
    assert anna.position_m.tolist() == [1.0, 2.0, 3.0]
    assert anna.velocity_mps is not None
    assert anna.velocity_mps.tolist() == [0.5, 0.0, 0.0]
    assert anna.yaw_rad == -3.0
    assert (ben.id, ben.velocity_mps, ben.yaw_rad) == ("ben", None, None)
    assert [p.id for p in second.people] == ["anna"]
    assert second.people[0].velocity_mps is None  # one of three is not known


def test_csv_needs_five_columns_only(tmp_path: Path) -> None:
    (got,) = read(csv(tmp_path, "id,stamp_ns,x_m,y_m,z_m\na,5,1,2,3\n"))
    assert (got.stamp_ns, got.frame_id, got.people[0].id) == (5, "map", "a")


@pytest.mark.parametrize("gap", [",,", "nan,nan,nan", "1,2,"])
def test_person_without_a_position_is_left_out_at_that_stamp(gap: str, tmp_path: Path) -> None:
    # Motion capture loses anna for one stamp; ben, and anna later, stay.
    text = "stamp_ns,id,x_m,y_m,z_m\n"
    text += "1,anna,1,2,3\n1,ben,4,5,6\n" + f"2,anna,{gap}\n2,ben,4,5,6\n" + "3,anna,1,2,3\n"
    got = read(csv(tmp_path, text))
    assert [[p.id for p in m.people] for m in got] == [["anna", "ben"], ["ben"], ["anna"]]


def test_person_with_nan_is_left_out_of_arrays_at_that_time(tmp_path: Path) -> None:
    pos, vel, yaw = np.ones((2, 2, 3)), np.zeros((2, 2, 3)), np.zeros((2, 2))
    pos[0, 0], vel[1, 0], yaw[1, 1] = np.nan, np.nan, np.nan
    np.savez(tmp_path / "gt.npz", t=np.array([1.0, 2.0]), pos=pos, vel=vel, yaw=yaw)
    first, second = read(tmp_path)
    assert [p.id for p in first.people] == ["1"]
    assert [(p.id, p.velocity_mps is None, p.yaw_rad) for p in second.people] == [
        ("0", True, 0.0),
        ("1", False, None),
    ]


def test_class_and_visibility_of_mot_text_are_no_positions(tmp_path: Path) -> None:
    # Ten columns as py-motmetrics names them, and as MOT16 has them with one more.
    path = mot(tmp_path, "1,1,10,20,30,40,1,1,0.86,-1\n2,1,10,20,30,40,1,7,1,-1\n")
    with pytest.raises(SourceError, match=r"only boxes.*class and visibility are not positions"):
        read(path)
    path.write_text("1,1,10,20,30,40,1,1,0.86,-1\n2,1,10,20,30,40,1,1.25,0.86,-1\n")
    assert len(read(path)) == 2  # a person in metres


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "lacks the column stamp_ns. Needed are stamp_ns, id, x_m"),
        ("id,stamp_ns,x_m,y_m\n", "lacks the column z_m"),
        ("id,stamp_ns,x_m,y_m,z_m\na,soon,1,2,3\n", "line 2: expected stamp_ns, got 'soon'"),
        ("id,stamp_ns,x_m,y_m,z_m\na,1,1,2,up\n", "line 2: z_m: expected a number, got 'up'"),
        ("id,stamp_ns,x_m,y_m,z_m\na,1,1,2,inf\n", "line 2: position_m.*finite"),
        ("id,stamp_ns,x_m,y_m,z_m\na,2,1,2,3\nb,1,1,2,3\n", "line 3: expected rising stamps"),
        ("id,stamp_ns,x_m,y_m,z_m\n", "has no row of kind truth"),
        ("kind,id,stamp_ns,x_m,y_m,z_m\ntrack,1,1,1,1,1\n", "has no row of kind truth"),
        ("id,stamp_ns,x_m,y_m,z_m\na\n", "line 2: expected stamp_ns, got ''"),
        ("id,stamp_ns,x_m,y_m,z_m\na,99999999999999999999,1,2,3\n", "line 2: stamp_ns"),
    ],
)
def test_damaged_csv_is_reported_with_its_line(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=message):
        read(csv(tmp_path, text))


def test_csv_that_is_no_text(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_bytes(b"\xff\xfe\x00" * 40)
    with pytest.raises(SourceError, match="cannot be read as CSV"):
        read(tmp_path / "x.csv")


def test_numbers_of_the_configuration_are_checked() -> None:
    for settings in (
        {"rate_hz": -1.0},
        {"gate_m": 0.0},
        {"align_clock_s": 9.0},
        {"offset_s": math.nan},
    ):
        with pytest.raises(ValueError, match=next(iter(settings))):
            GtBridgeConfig(**settings)  # type: ignore[arg-type]


def test_mot_text_that_would_cost_too_much_is_refused(tmp_path: Path) -> None:
    row = "10,20,30,40,1,1,2,0"
    path = mot(tmp_path, f"99999999999,1,{row}\n")
    with pytest.raises(SourceError, match="has a frame 99999999999, beyond"):
        read(path)
    path.write_text(f"1e300,1,{row}\n")
    with pytest.raises(SourceError, match="a frame from 1"):
        read(path)
    path.write_text(f"1,1,{row}\n")
    info = tmp_path / "seqinfo.ini"
    info.write_text(SEQINFO.replace("25", "1e-300"))
    with pytest.raises(SourceError, match="got ValueError: frameRate 1e-300"):
        read(path)
    # Ten values, each ten times the one before.
    more = "".join(f"a{k}={f'%(a{k - 1})s' * 10}\n" for k in range(1, 10))
    info.write_text(SEQINFO + "a0=x\n" + more + "b=%(a9)s\n")
    assert len(read(path)) == 1


def test_csv_that_would_cost_too_much_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    head = "stamp_ns,id,x_m,y_m,z_m\n"
    path.write_text(head + "1," + "a" * 10**6)
    with pytest.raises(SourceError, match="a line has 16384 characters or more"):
        read(path)
    path.write_text(head + "1,a,1,2,3\n" * 5000)
    with pytest.raises(SourceError, match="more than 4096 people of one stamp"):
        read(path)
    path.write_text(head.strip() + ",a" * 300 + "\n")
    with pytest.raises(SourceError, match="more than 256 columns"):
        read(path)
    path.write_text(head + f"{2**62},a,1,2,3\n")
    assert len(read(path)) == 1
    stored = TruthPlayback(
        GtBridgeConfig(truth=str(path), offset_s=1.0),
        open_truth(GtBridgeConfig(truth=str(path))),
        Counter(),
        lambda truth: truth,
    )
    assert "cannot be moved so far" in stored.problem


@pytest.mark.parametrize(
    "arrays",
    [
        {"t": [1e300]},
        {"t": [np.nan]},
        {"t": [1.0, 2.0]},
        {"pos": [[[1.0, 2.0]]]},
        {"yaw": [0.0]},
        {"vel": [[["a", "b", "c"]]]},
        {"pos": np.zeros((1, 5000, 3)), "vel": np.zeros((1, 5000, 3)), "yaw": np.zeros((1, 5000))},
    ],
)
def test_arrays_that_are_no_truth_are_refused(arrays: dict[str, Any], tmp_path: Path) -> None:
    sound = {"t": [1.0], "pos": [[[1.0, 2.0, 3.0]]], "vel": [[[0.0] * 3]], "yaw": [[0.0]]}
    np.savez(tmp_path / "gt.npz", **(sound | arrays))  # type: ignore[arg-type]
    with pytest.raises(SourceError, match="cannot be read"):
        read(tmp_path)
