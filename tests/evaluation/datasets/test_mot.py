"""MOT15, MOT17, MOT20 and DanceTrack: files, truth, figures, submission and wrong files."""

import json
from pathlib import Path

import pytest

from evaluation.datasets.dataset import DatasetJob
from evaluation.datasets.mot import DANCETRACK, MOT15, MOT17, MOT20, MotDataset, submission
from evaluation.methods import read_method
from people4d.errors import ConfigError, SourceError
from tests.evaluation.datasets.mot import write_drawn, write_mot
from tests.evaluation.datasets.people import drawn_boxes, lab_people

REFERENCE = json.loads((Path(__file__).parent / "reference.json").read_text())
TRAIN = "train/MOT17-02-FRCNN"


@pytest.mark.parametrize("dataset", [MOT17, MOT20, DANCETRACK, MOT15], ids=lambda d: d.title)
def test_figures_are_those_of_trackeval(tmp_path: Path, dataset: MotDataset) -> None:
    found = dataset.load(write_drawn(tmp_path)).score(drawn_boxes().tracks).row()
    expected = REFERENCE["MOT17" if dataset is DANCETRACK else dataset.title]
    assert {name: found[name] for name in expected} == pytest.approx(expected, abs=1e-8)


def test_sequences_of_all_splits_and_their_truth(tmp_path: Path) -> None:
    write_mot(tmp_path)
    assert list(MOT17.sequences(tmp_path)) == ["test/MOT17-01-FRCNN", TRAIN]
    one = MOT17.load(tmp_path / TRAIN)
    assert one.truth is not None
    for frame, truth, people in zip(one.frames, one.truth, lab_people(), strict=True):
        left, top, width, height = people[0].box_px
        assert frame.boxes_xyxy_px[0].tolist() == [left, top, left + width, top + height]
        assert truth.boxes_xyxy_px.tolist() == frame.boxes_xyxy_px.tolist()
        assert truth.ids == tuple(person.id for person in people)
    assert MOT17.load(tmp_path / "test" / "MOT17-01-FRCNN").truth is None


def test_perfect_detections_of_two_people_are_tracked_without_an_error(tmp_path: Path) -> None:
    write_mot(tmp_path)
    result = MOT17.evaluate(
        DatasetJob(tmp_path, TRAIN, read_method("image-sort-dynamic"), tmp_path)
    )
    assert result.figures is not None
    row = result.figures.row()
    assert (row["mota"], row["idf1"], row["id_switches"]) == (1.0, 1.0, 0)


@pytest.mark.slow
def test_dynamic_lifetime_is_better_than_sort_on_real_sequences_of_the_test_split(
    shared: Path,
) -> None:
    folder = shared / "data"
    assert "mot15/KITTI-17" in MOT15.sequences(folder)
    gains = []
    for name in ("mot15/KITTI-17", "mot15/TUD-Campus"):
        figures = []
        for preset in ("image-sort", "image-sort-dynamic"):
            found = MOT15.evaluate(DatasetJob(folder, name, read_method(preset), folder)).figures
            assert found is not None
            figures.append(found.row())
        gains += [(figures[1][f] or 0) - (figures[0][f] or 0) for f in ("mota", "idf1", "hota")]
    assert min(gains) >= 0
    assert max(gains) > 0.02


def test_a_submission_has_a_file_for_each_sequence_of_the_test_split(tmp_path: Path) -> None:
    write_mot(tmp_path)
    method = read_method("image-sort-dynamic")
    result = MOT17.evaluate(DatasetJob(tmp_path, "test/MOT17-01-FRCNN", method, tmp_path))
    assert result.figures is None
    ((name, text),) = result.submission.items()
    left, top, width, height = lab_people()[0][0].box_px
    assert name == "MOT17-01-FRCNN.txt"
    assert text.startswith(f"1,1,{left:.2f},{top:.2f},{width:.2f},{height:.2f},1,-1,-1,-1\n")
    assert len(text.splitlines()) == sum(map(len, lab_people()))


def test_a_submission_holds_the_tracks_of_each_frame() -> None:
    tracks = drawn_boxes().tracks[:2]
    numbers = [line.split(",")[:2] for line in submission(tracks).splitlines()]
    assert numbers == [[str(n), str(one)] for n, t in enumerate(tracks, 1) for one in t.ids]


@pytest.mark.parametrize("missing", ["det/det.txt", "gt/gt.txt"])
def test_half_a_download_is_named(tmp_path: Path, missing: str) -> None:
    (write_mot(tmp_path) / TRAIN / missing).unlink()
    with pytest.raises(SourceError, match=f"expected {missing.split('/')[1]}, got an empty folder"):
        MOT17.sequences(tmp_path)


def test_an_empty_folder_is_refused_with_its_download(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"seqinfo.ini, got an empty folder.*motchallenge.net"):
        MOT17.sequences(tmp_path)


def test_another_version_is_refused(tmp_path: Path) -> None:
    write_mot(tmp_path)
    with pytest.raises(SourceError, match=r"expected a sequence MOT20-..., got MOT17-01-FRCNN"):
        MOT20.sequences(tmp_path)
    gt = tmp_path / TRAIN / "gt" / "gt.txt"
    gt.write_text("1,1,10,10,20,40,1,-1,-1,-1\n")  # MOT15
    with pytest.raises(SourceError, match=r"gt.txt: expected class and visibility in columns 8"):
        MOT17.load(tmp_path / TRAIN)


def test_truth_of_a_longer_sequence_is_refused(tmp_path: Path) -> None:
    write_mot(tmp_path)
    (tmp_path / TRAIN / "gt" / "gt.txt").write_text("900,1,10,10,20,40,1,1,1\n")
    with pytest.raises(SourceError, match=r"gt.txt: expected at most 8 frames, got frame 900"):
        MOT17.load(tmp_path / TRAIN)


def test_test_split_is_refused_for_tuning() -> None:
    MOT17.check_tuning([TRAIN])
    with pytest.raises(ConfigError, match=r"MOT17: tuning expected train/\*, got test/MOT17-01"):
        MOT17.check_tuning([TRAIN, "test/MOT17-01-FRCNN"])


def test_a_tracker_that_needs_depth_is_refused(tmp_path: Path) -> None:
    write_mot(tmp_path)
    with pytest.raises(ConfigError, match="best: expected a tracker of boxes, got strongsort3d"):
        MOT17.evaluate(DatasetJob(tmp_path, TRAIN, read_method("best"), tmp_path))
