"""Text files of the MOT-Challenge, valid and invalid."""

from pathlib import Path

import numpy as np
import pytest

from common.metrics.mot_text import MotInfo, read_info, read_rows, sequence
from common.metrics.record import Hypotheses
from common.metrics.scores import score
from common.metrics.similarity import box_overlap
from people4d.errors import DecodeError


def written(folder: Path, text: str) -> Path:
    path = folder / "gt.txt"
    path.write_text(text)
    return path


def test_lines_are_ordered_by_frame_and_boxes_have_corners(tmp_path: Path) -> None:
    rows = read_rows(written(tmp_path, "2,7,10,20,30,40,1,-1,-1,-1\n\n1,7,0,0,5.5,6,0.5\n"))
    assert rows.frames.tolist() == [1, 2]
    assert rows.ids.tolist() == [7, 7]
    assert rows.boxes_xyxy_px.tolist() == [[0, 0, 5.5, 6], [10, 20, 40, 60]]
    assert rows.frame_rows(2).confidences.tolist() == [1.0]
    assert rows.frame_rows(3).ids.tolist() == []


def test_detections_have_no_identity(tmp_path: Path) -> None:
    rows = read_rows(written(tmp_path, "1,-1,0,0,5,6,0.9,-1,-1,-1\n1,-1,9,0,5,6,0.8,-1,-1,-1\n"))
    assert rows.ids.tolist() == [-1, -1]


def test_an_empty_file_has_no_lines(tmp_path: Path) -> None:
    assert len(read_rows(written(tmp_path, "")).frames) == 0


@pytest.mark.parametrize(
    "line",
    [
        *("1,2,3", "1,8,0,0,5,x,1", "1,8,0,0,nan,6,1", "0,8,0,0,5,6,1", "1,8.5,0,0,5,6,1"),
        *("1,8,0,0,-5,6,1", "1.5,8,0,0,5,6,1", "1e300,8,0,0,5,6,1", "1,8,0,0,5,6,1,1,1,1,1"),
    ],
)
def test_a_bad_line_is_named_with_the_expected_layout(tmp_path: Path, line: str) -> None:
    with pytest.raises(DecodeError, match=f"line 2: expected frame,id.*, got '{line}'"):
        read_rows(written(tmp_path, f"1,7,0,0,5,6,1\n{line}\n"))


def test_repeated_identity_in_a_frame_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DecodeError, match=r"line 2: .*got id 7 of frame 1 again \(first in line 1"):
        read_rows(written(tmp_path, "1,7,0,0,5,6,1\n1,7,0,0,5,6,1\n"))


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(DecodeError, match=r"det\.txt: expected a readable text file"):
        read_rows(tmp_path / "det.txt")


def test_info(tmp_path: Path) -> None:
    text = "[Sequence]\nname=walk\nframeRate=25\nseqLength=3\nimWidth=640\nimHeight=480\n"
    assert read_info(written(tmp_path, text)) == MotInfo("walk", 25.0, 3, 640, 480)
    for bad in (text.replace("25", "fast"), text.replace("name=walk", ""), "", "name=walk"):
        with pytest.raises(DecodeError, match="with name, frameRate, seqLength"):
            read_info(written(tmp_path, bad))


def test_a_rate_must_be_positive(tmp_path: Path) -> None:
    text = "[Sequence]\nname=walk\nframeRate=0\nseqLength=3\nimWidth=640\nimHeight=480\n"
    with pytest.raises(DecodeError, match="frameRate"):
        read_info(written(tmp_path, text))


@pytest.mark.parametrize(
    "changed", ["seqLength=0", "seqLength=2000000000", "imWidth=-4", "frameRate=1e-300"]
)
def test_a_sequence_without_extent_is_refused(tmp_path: Path, changed: str) -> None:
    text = "name=walk\nframeRate=25\nseqLength=3\nimWidth=640\nimHeight=480\n"
    lines = [x for x in text.splitlines() if not x.startswith(changed.partition("=")[0])]
    with pytest.raises(DecodeError, match="frameRate"):
        read_info(written(tmp_path, "\n".join(["[Sequence]", *lines, changed])))


def test_flagged_truth_is_dropped_and_frames_have_stamps(tmp_path: Path) -> None:
    truth = read_rows(written(tmp_path, "1,7,0,0,10,10,1\n1,8,50,0,10,10,0\n3,7,0,0,10,10,1\n"))
    tracks = {1: Hypotheses(ids=(1,), boxes_xyxy_px=np.array([[0.0, 0.0, 10.0, 10.0]]))}
    recording = sequence(MotInfo("walk", 25.0, 3, 640, 480), truth, tracks)
    assert [frame.stamp_ns for frame in recording.frames] == [0, 40_000_000, 80_000_000]
    assert [frame.truth.ids for frame in recording.frames] == [(7,), (), (7,)]
    counts = score(recording, box_overlap).clear
    assert (counts.matches, counts.misses, counts.false_alarms) == (1, 1, 0)


def test_positions_where_the_file_has_them(tmp_path: Path) -> None:
    # Ten columns with a position, ten without, nine (class and visibility of MOT16), seven.
    text = "1,1,0,0,5,6,1,1.5,-2,0\n1,2,0,0,5,6,1,-1,-1,-1\n1,3,0,0,5,6,1,1,0.5\n1,4,0,0,5,6,1\n"
    rows = read_rows(written(tmp_path, text))
    assert rows.positions_m[0].tolist() == [1.5, -2.0, 0.0]
    assert np.isnan(rows.positions_m[1:]).all()
    assert rows.frame_rows(1).evaluated().positions_m.shape == (4, 3)
