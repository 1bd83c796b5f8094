"""Files of motion capture, read again."""

import struct
from pathlib import Path

import numpy as np
import pytest

from deploy.exporters.motion_files import write_motion
from evaluation.gait.motion import JointMotion
from people4d.messages.skeleton import JOINTS

LEFT_HIP, NOSE = JOINTS.index("left_hip"), JOINTS.index("nose")


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """Return a folder with the files of four frames; the nose is unknown in the last one."""
    joints_m = np.zeros((4, 17, 3))
    joints_m[:, LEFT_HIP] = (1.0, 2.0, 0.9)  # 2 m to the left, 0.9 m high
    joints_m[3, NOSE] = np.nan
    write_motion(tmp_path, "person_1", JointMotion(0.5, 20.0, joints_m))
    return tmp_path


def test_trc_has_y_up_and_empty_unknown_markers(files: Path) -> None:
    lines = [line.split("\t") for line in (files / "person_1.trc").read_text().splitlines()]
    assert lines[0] == ["PathFileType", "4", "(X/Y/Z)", "person_1.trc"]
    assert lines[2][:5] == ["20", "20", "4", "17", "mm"]
    assert lines[3][2::3] == list(JOINTS)
    first, *_, last = lines[6:]
    assert first[:2] == ["1", "0.500000"]
    assert first[2 + 3 * LEFT_HIP :][:3] == ["1000.00", "900.00", "-2000.00"]
    assert last[:5] == ["4", "0.650000", "", "", ""]
    assert {len(line) for line in lines[6:]} == {2 + 3 * 17}


def test_c3d_has_header_and_positions_in_its_blocks(files: Path) -> None:
    data = (files / "person_1.c3d").read_bytes()
    block, magic, points, analog, first, last, _, scale, start, _, rate = struct.unpack_from(
        "<BBHHHHHfHHf", data
    )
    assert (block, magic, points, analog, first, last) == (2, 0x50, 17, 0, 1, 4)
    assert (scale, rate) == (-1.0, 20.0)
    found = np.frombuffer(data, "<f4", 4 * 17 * 4, 512 * (start - 1)).reshape(4, 17, 4)
    assert found[0, LEFT_HIP].tolist() == [1000.0, 900.0, -2000.0, 0.0]
    assert found[3, NOSE].tolist() == [0.0, 0.0, 0.0, -1.0]
    assert len(data) % 512 == 0


def test_c3d_is_read_by_ezc3d(files: Path) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    read = ezc3d.c3d(str(files / "person_1.c3d"))
    assert read["parameters"]["POINT"]["LABELS"]["value"] == list(JOINTS)
    assert read["parameters"]["POINT"]["RATE"]["value"][0] == 20.0
    points = read["data"]["points"]
    assert points[:3, LEFT_HIP, 0].tolist() == [1000.0, 900.0, -2000.0]
    assert np.isnan(points[:3, NOSE, 3]).all()


def test_trc_is_read_by_opensim(files: Path) -> None:
    opensim = pytest.importorskip("opensim")
    table = opensim.TimeSeriesTableVec3(str(files / "person_1.trc"))
    assert list(table.getColumnLabels()) == list(JOINTS)
    assert list(table.getIndependentColumn()) == pytest.approx([0.5, 0.55, 0.6, 0.65])
    assert table.getTableMetaDataAsString("Units") == "mm"
    assert table.getDependentColumn("left_hip")[0].to_numpy().tolist() == [1000.0, 900.0, -2000.0]
    assert np.isnan(table.getDependentColumn("nose")[3].to_numpy()).all()
