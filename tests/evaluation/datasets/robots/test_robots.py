"""TUM RGB-D, KTP, RIMT and TPT-Bench: files, truth, figures, results and wrong files."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from common.metrics.scores import Row
from evaluation.datasets.dataset import Dataset, DatasetJob
from evaluation.datasets.registry import DATASETS, find_dataset
from evaluation.datasets.robots import ktp, rimt, target_scores, tpt, trajectories, tum
from evaluation.datasets.robots.target_scores import ABSENT, Answer, TargetTruth
from evaluation.methods import read_method
from people4d.errors import ConfigError, SourceError
from people4d.messages import F64
from tests.evaluation.datasets.robots.miniatures import (
    SEQUENCE,
    lab_frames,
    write_ktp,
    write_rimt,
    write_tpt,
    write_tum,
)

STILL = "ground_truth/Still_gt2D.txt"
BAG = "Manually_annotated_bags/still.bag"


def run(dataset: Dataset, folder: Path, sequence: str) -> tuple[Row, str]:
    """Run the default method; return the figures and the file of results."""
    assert list(dataset.sequences(folder)) == [sequence]
    (method,) = dataset.methods((), ())
    result = dataset.evaluate(DatasetJob(folder, sequence, method, folder / "cache"))
    assert result.figures is not None
    return result.figures.row(), next(iter(result.submission.values()), "")


def test_tum_camera_that_stands_is_estimated_to_stand(tmp_path: Path) -> None:
    write_tum(tmp_path)
    row, text = run(tum.TUM, tmp_path, SEQUENCE)
    assert row["ate_rmse_m"] == pytest.approx(0.0, abs=0.01)
    times = [line.split()[0] for line in text.splitlines()]
    assert times == [one.time[:-3] for one in lab_frames()][: len(times)]
    assert len(times) >= len(lab_frames()) - 1
    poses = tmp_path / "estimate.txt"
    poses.write_text(text)
    assert len(trajectories.read_poses(poses)) == len(times)


def straight(factor: float, turn: F64) -> dict[float, F64]:
    """Return poses at 0 to 4 s on a line, 1 m/s times a factor, seen from a turned frame."""
    poses = {}
    for time_s in range(5):
        poses[float(time_s)] = pose = np.eye(4)
        pose[0, 3] = factor * time_s
        poses[float(time_s)] = turn @ pose
    return poses


def test_trajectory_errors_are_those_of_the_benchmark_s_tools() -> None:
    """Of 0, 1.1, ... 4.4 m against 0, 1, ... 4 m.

    Aligned at the mean, distances are 0.2, 0.1, 0, 0.1, 0.2 m: root mean square sqrt(0.1 / 5).
    Motions in 1 s are off by 0.1 m; evaluate_rpe.py leaves out those to the last pose.
    """
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("zyx", [0.7, 0.2, -0.4]).as_matrix()
    turn[:3, 3] = 3.0, -2.0, 1.0
    row = trajectories.score(straight(1.1, turn), straight(1.0, np.eye(4))).row()
    assert row["ate_rmse_m"] == pytest.approx(0.02**0.5)
    assert row["rpe_rmse_m"] == pytest.approx(0.1)
    assert row["rpe_rmse_rad"] == pytest.approx(0.0, abs=1e-6)
    assert trajectories.score(straight(1.1, turn), straight(1.0, np.eye(4))).motions == 3


def test_ktp_people_are_tracked_in_annotated_images(tmp_path: Path) -> None:
    write_ktp(tmp_path)
    truth = ktp.read_truth(tmp_path / STILL)
    for one, (stamp_ns, boxes) in zip(lab_frames(), truth.items(), strict=True):
        assert stamp_ns == one.stamp_ns
        found = [(a, b, c - a, d - b) for a, b, c, d in boxes.boxes_xyxy_px.tolist()]
        assert dict(zip(boxes.ids, found, strict=True)) == one.boxes_px
    row, text = run(ktp.KTP, tmp_path, "Still")
    assert row["truths"] == sum(len(one.boxes_px) for one in lab_frames())
    assert row["mota"] is not None
    assert row["mota"] > 0.6
    assert row["id_switches"] == 0
    assert all(len(line.split(",")) == 10 for line in text.splitlines())


def test_rimt_people_are_tracked_against_motion_capture(tmp_path: Path) -> None:
    row, text = run(rimt.RIMT, write_rimt(tmp_path), BAG)
    assert text == ""
    assert row["truths"] == sum(len(one.positions_m) for one in lab_frames())
    assert row["mota"] is not None
    assert row["mota"] > 0.6
    errors_m = [row[name] for name in ("position_rmse_x_m", "position_rmse_y_m")]
    assert all(error_m is not None and error_m < 0.2 for error_m in errors_m)


def test_rimt_truth_has_gaps() -> None:
    """Positions at 0, 0.1 and 0.5 s: known up to 0.1 s and at 0.5 s."""
    times_s = np.array([0.0, 0.1, 0.5])
    path = times_s, np.array([[0.0, 0, 1], [1.0, 0, 1], [5.0, 0, 1]])
    found = [rimt.at(path, time_s) for time_s in (-0.01, 0.05, 0.3, 0.5, 0.6)]
    assert [None if one is None else one.tolist() for one in found] == [
        *(None, [0.5, 0.0, 1.0], None, [5.0, 0.0, 1.0], None)
    ]


def test_tpt_target_is_the_track_on_the_first_box(tmp_path: Path) -> None:
    write_tpt(tmp_path)
    row, text = run(tpt.TPT, tmp_path, "0000")
    answers = json.loads(text)
    assert list(answers) == [str(one.stamp_ns) for one in lab_frames()]
    assert all(len(one["target_info"]) == 5 for one in answers.values())
    assert row["ao"] is not None
    assert row["ao"] > 0.5


PRESENT = TargetTruth(is_exist=True, bbox=(10, 10, 9, 19))
GONE = TargetTruth(is_exist=False, bbox=(0, 0, 0, 0))


def test_tpt_figures_are_those_of_its_tool() -> None:
    """Right at 0.9, on somebody else at 0.8, missed, and a false answer at 0.7.

    Overlaps are 1, 0, 0, 0. Mean over the three images with the person: 1/3. At the threshold 0.9
    precision is 1 and recall 1/3: F = 2 * 1/3 / (4/3 + 1e-6), and the largest recall at full
    precision is 1/3 for all overlaps.
    """
    truth = {"1": PRESENT, "2": PRESENT, "3": PRESENT, "4": GONE}
    right, other = (10.0, 10.0, 9.0, 19.0), (200.0, 10.0, 9.0, 19.0)
    answers: dict[str, Answer] = {"1": (*right, 0.9), "2": (*other, 0.8), "3": ABSENT}
    row = target_scores.score(truth, answers | {"4": (*other, 0.7)}).row()
    third = 1 / 3
    expected = {"ao": third, "f_score": 2 * third / (4 * third + 1e-6), "max_recall": third}
    assert row == pytest.approx(expected)


# Figures of evaluate_baselines.py for the answers drawn below
REFERENCE = {
    "ao": 0.5163457646201708,
    "f_score": 0.4858672200315468,
    "max_recall": 0.20075757575757577,
}


def test_tpt_figures_of_a_long_sequence_equal_evaluate_baselines() -> None:
    """Expected values come from the data set's tool on the same drawn answers."""
    random = np.random.RandomState(3)
    truth, answers = {}, dict[str, Answer]()
    for number in range(400):
        box = tuple(random.randint([0, 0, 20, 40], [300, 200, 80, 160]).tolist())
        exists = random.random_sample() < 0.8
        truth[str(number)] = TargetTruth(is_exist=bool(exists), bbox=box) if exists else GONE
        confidence = float(np.round(random.random_sample(), 3)) * (1.0 if exists else 0.6)
        near = np.array(box) + random.normal(0, 20, 4) * (1 - confidence)
        given = random.random_sample() < 0.9
        answers[str(number)] = (*near.tolist(), confidence) if given else ABSENT
    assert target_scores.score(truth, answers).row() == pytest.approx(REFERENCE, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "write", "missing", "expected"),
    [
        ("tum", write_tum, f"{SEQUENCE}/depth.txt", "expected depth.txt, got"),
        ("tum", write_tum, f"{SEQUENCE}/groundtruth.txt", "expected groundtruth.txt, got"),
        ("ktp", write_ktp, STILL, "expected Still_gt2D.txt, got an empty folder"),
        ("ktp", write_ktp, "images/Still/depth", "expected depth, got rgb"),
        ("rimt", write_rimt, BAG, "expected SEQUENCE.bag, got an empty folder"),
        ("tpt", write_tpt, "GTs", "expected GTs, got panoramic_images"),
        ("tpt", write_tpt, "panoramic_images/0000", "expected 0000, got an empty folder"),
    ],
)
def test_missing_part_is_named(
    tmp_path: Path, name: str, write: Callable[[Path], object], missing: str, expected: str
) -> None:
    write(tmp_path)
    path = tmp_path / missing
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    with pytest.raises(SourceError, match=expected):
        find_dataset(name).sequences(tmp_path)


def shifted(path: Path) -> None:
    """Move the truth of TUM by a day."""
    lines = path.read_text().splitlines()[2:]
    words = [line.split() for line in lines]
    moved = [" ".join([f"{float(w[0]) + 86_400:.4f}", *w[1:]]) for w in words]
    path.write_text("\n".join(moved))


@pytest.mark.parametrize(
    ("name", "write", "file", "change", "expected"),
    [
        (
            *("tum", write_tum, f"{SEQUENCE}/groundtruth.txt", shifted),
            r"groundtruth.txt: expected poses from 1341846313.000 to 1341846314.467 s, got",
        ),
        (
            *("tum", write_tum, f"{SEQUENCE}/groundtruth.txt"),
            lambda path: path.write_text("0.0 1 2 3\n"),
            "groundtruth.txt: line 1: expected 8 numbers, got '0.0 1 2 3'",
        ),
        (
            *("tum", write_tum, f"{SEQUENCE}/depth.txt", lambda path: path.write_text("#\n")),
            "no image of rgb.txt is within 0.02 s of one of depth.txt",
        ),
        (
            *("ktp", write_ktp, STILL, lambda path: path.write_text("9.5: 1 2 3 4 5,\n")),
            "Still_gt2D.txt: expected times of images in .*, got 1 of 1 times without one",
        ),
        (
            *("ktp", write_ktp, STILL, lambda path: path.write_text("9.5: 1 0.1 0.2 0.3,\n")),
            "Still_gt2D.txt: line 1: expected a time, a colon, and id, left, top",
        ),
        (
            *("tpt", write_tpt, "GTs/0000.json", lambda path: path.write_text('{"5": [1, 2]}')),
            "0000.json: expected times with is_exist and bbox, got",
        ),
        (
            *("tpt", write_tpt, f"panoramic_images/0000/{lab_frames()[3].stamp_ns}.jpg"),
            Path.unlink,
            f"expected {lab_frames()[3].stamp_ns}.jpg, got",
        ),
    ],
)
def test_wrong_file_is_refused(
    tmp_path: Path,
    name: str,
    write: Callable[[Path], object],
    file: str,
    change: Callable[[Path], object],
    expected: str,
) -> None:
    write(tmp_path)
    change(tmp_path / file)
    dataset = find_dataset(name)
    (sequence,) = dataset.sequences(tmp_path)
    job = DatasetJob(tmp_path, sequence, read_method(dataset.preset), tmp_path / "cache")
    with pytest.raises(SourceError, match=expected):
        dataset.evaluate(job)


def test_rimt_bag_without_truth_and_clock_of_another_day_are_refused(tmp_path: Path) -> None:
    write_rimt(tmp_path, truth=False)
    job = DatasetJob(tmp_path, BAG, read_method("best"), tmp_path / "cache")
    with pytest.raises(SourceError, match=r"still.bag: expected topics /3D_ground_truth_N, got"):
        rimt.RIMT.evaluate(job)
    write_rimt(tmp_path / "late", shift_ns=10**12)
    job = DatasetJob(tmp_path / "late", BAG, read_method("best"), tmp_path / "cache")
    with pytest.raises(SourceError, match=r"expected truth in the time of the images, .*, got"):
        rimt.RIMT.evaluate(job)


def test_tpt_needs_a_tracker_of_boxes(tmp_path: Path) -> None:
    job = DatasetJob(write_tpt(tmp_path), "0000", read_method("best"), tmp_path / "cache")
    with pytest.raises(ConfigError, match="expected a tracker of boxes, got strongsort3d"):
        tpt.TPT.evaluate(job)


@pytest.mark.parametrize("name", ["tum", "ktp", "rimt", "tpt"])
def test_sequences_of_the_test_split_are_refused_for_tuning(name: str) -> None:
    assert name in DATASETS
    with pytest.raises(ConfigError, match=f"tuning expected .*, got {SEQUENCE}"):
        find_dataset(name).check_tuning([SEQUENCE])


def test_tpt_truth_without_the_target_is_refused(tmp_path: Path) -> None:
    (write_tpt(tmp_path) / "GTs" / "0000.json").write_text("{}")
    with pytest.raises(SourceError, match="no time at which the target exists"):
        run(tpt.TPT, tmp_path, "0000")
