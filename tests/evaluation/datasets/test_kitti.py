"""KITTI tracking: files, truth, odometry, figures, submission and wrong files."""

import json
from pathlib import Path

import pytest

from evaluation.datasets.dataset import DatasetJob
from evaluation.datasets.kitti import KITTI
from evaluation.methods import read_method
from people4d.errors import ConfigError, SourceError
from tests.evaluation.datasets.kitti import write_drawn, write_kitti, write_split
from tests.evaluation.datasets.people import lab_people

REFERENCE = json.loads((Path(__file__).parent / "reference.json").read_text())
TRAIN = "training/0000"


def test_figures_are_those_of_trackeval(tmp_path: Path) -> None:
    tracks = write_drawn(tmp_path).tracks
    found = KITTI.load(tmp_path, TRAIN).score(tracks).row()
    expected = REFERENCE["KITTI tracking"]
    assert {name: found[name] for name in expected} == pytest.approx(expected, abs=1e-8)


def test_frames_have_detections_and_the_turn_of_the_car(tmp_path: Path) -> None:
    write_kitti(tmp_path)
    assert list(KITTI.sequences(tmp_path)) == ["testing/0000", TRAIN]
    one = KITTI.load(tmp_path, TRAIN)
    assert one.rate_hz == pytest.approx(10.0)
    assert [frame.turn.rad for frame in one.frames[:3]] == pytest.approx([0.0, 0.01, 0.01])
    assert one.truth is not None
    left, top, width, height = lab_people()[3][1].box_px
    assert one.frames[3].boxes_xyxy_px[1].tolist() == [left, top, left + width, top + height]
    assert one.truth[3].boxes_xyxy_px.tolist() == one.frames[3].boxes_xyxy_px.tolist()
    assert KITTI.load(tmp_path, "testing/0000").truth is None


def test_real_labels_of_sequence_0019_are_read(tmp_path: Path, shared: Path) -> None:
    labels = (shared / "data" / "egomotion" / "kitti_0019" / "labels.txt").read_text()
    write_split(tmp_path, "training", 1059, [], labels.splitlines(keepends=True))
    truth = KITTI.load(tmp_path, TRAIN).truth
    assert truth is not None
    rows = [line.split() for line in labels.splitlines()]
    clear = [r for r in rows if r[2] == "Pedestrian" and int(r[3]) <= 0 and int(r[4]) <= 2]
    assert sum(one.evaluated.sum() for one in truth) == len(clear) > 1000
    assert sum(len(one.regions_xyxy_px) for one in truth) == sum(r[2] == "DontCare" for r in rows)


def test_a_submission_has_18_columns_and_frames_from_0(tmp_path: Path) -> None:
    write_kitti(tmp_path)
    job = DatasetJob(tmp_path, "testing/0000", read_method("image-sort-dynamic"), tmp_path)
    result = KITTI.evaluate(job)
    assert result.figures is None
    rows = [line.split() for line in result.submission["testing/0000.txt"].splitlines()]
    assert {len(row) for row in rows} == {18}
    left, top, width, height = lab_people()[0][0].box_px
    assert rows[0][:6] == ["0", "1", "Pedestrian", "-1", "-1", "-10"]
    assert list(map(float, rows[0][6:10])) == [left, top, left + width, top + height]


@pytest.mark.parametrize("part", ["oxts", "label_02"])
def test_half_a_download_is_named(tmp_path: Path, part: str) -> None:
    (write_kitti(tmp_path) / "training" / part / "0000.txt").unlink()
    with pytest.raises(SourceError, match=rf"{part}: expected 0000.txt, got an empty folder"):
        KITTI.sequences(tmp_path)


def test_labels_of_single_images_are_refused(tmp_path: Path) -> None:
    path = write_kitti(tmp_path) / "training" / "label_02" / "0000.txt"
    path.write_text("Pedestrian 0.00 0 -0.20 712 143 810 307 1.89 0.48 1.20 1.84 1.47 8.41 0.01\n")
    with pytest.raises(
        SourceError, match=r"line 1: expected 17 columns, a frame first, .* got Pede"
    ):
        KITTI.load(tmp_path, TRAIN)


def test_labels_of_a_longer_sequence_are_refused(tmp_path: Path) -> None:
    path = write_kitti(tmp_path) / "training" / "label_02" / "0000.txt"
    path.write_text(path.read_text().replace("\n7 ", "\n800 "))
    with pytest.raises(SourceError, match=r"expected frames 0 to 7 as in oxts, got frame 800"):
        KITTI.load(tmp_path, TRAIN)


def test_validation_split_is_refused_for_tuning() -> None:
    KITTI.check_tuning([TRAIN, "training/0002"])
    with pytest.raises(ConfigError, match="got training/0001"):
        KITTI.check_tuning([TRAIN, "training/0001"])


@pytest.mark.parametrize("part", ["oxts", "label_02", "det_02"])
@pytest.mark.parametrize("word", ["nan", "half"])
def test_lines_without_numbers_are_refused(tmp_path: Path, part: str, word: str) -> None:
    path = write_kitti(tmp_path) / "training" / part / "0000.txt"
    first, *others = path.read_text().splitlines()
    words = first.split()
    words[3] = word
    path.write_text("\n".join([" ".join(words), *others]))
    with pytest.raises(SourceError, match="numbers"):
        KITTI.load(tmp_path, TRAIN)
