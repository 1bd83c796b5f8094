"""JRDB: files, truth, OSPA, submission and wrong files."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluation.datasets.boxes import BoxTruth
from evaluation.datasets.dataset import DatasetJob
from evaluation.datasets.jrdb import FILES, JRDB, TRAINING
from evaluation.datasets.ospa import ospa
from evaluation.methods import read_method
from people4d.errors import SourceError
from services.tracker.image_sort.image_sort import BoxTracks
from tests.evaluation.datasets.people import AnnotatedPerson, lab_people

TEST = "test_dataset_without_labels"
NAME = "meyer-green-2019-03-16_0"


def label(one: AnnotatedPerson, occlusion: str = "Fully_visible") -> dict[str, Any]:
    attributes = {"occlusion": occlusion, "truncated": "false", "no_eval": False}
    return {"box": one.box_px, "label_id": f"pedestrian:{one.id}", "attributes": attributes}


def write(folder: Path, split: str, key: str, images: dict[str, Any], name: str = NAME) -> None:
    path = folder / split / FILES[key] / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({key: images}))


def write_jrdb(folder: Path) -> Path:
    """Write a training sequence whose second person is fully occluded, and two test sequences."""
    images = {f"{k:06}.jpg": visible for k, visible in enumerate(lab_people())}
    found = {
        image: [{"box": one.box_px, "label_id": "person:-1", "score": 0.9} for one in visible]
        for image, visible in images.items()
    }
    kinds = ("Fully_visible", "Fully_occluded")
    labels = {
        image: [label(one, kind) for one, kind in zip(visible, kinds, strict=True)]
        for image, visible in images.items()
    }
    write(folder, TRAINING, "detections", found)
    write(folder, TRAINING, "labels", labels)
    write(folder, TEST, "detections", found)
    write(folder, TEST, "detections", found, "cubberly-auditorium-2019-04-22_1")
    return folder


def tracks(*boxes: tuple[int, list[float]]) -> BoxTracks:
    ids = np.array([one for one, _ in boxes], np.int64)
    ltrb = np.array([box for _, box in boxes], np.float64).reshape(-1, 4)
    return BoxTracks(ids, ltrb, np.ones(len(ids)), ids)


def truth(*boxes: tuple[int, list[float]]) -> BoxTruth:
    found = tracks(*boxes)
    every = np.ones(len(boxes), np.bool_)
    return BoxTruth(tuple(found.ids.tolist()), found.boxes_xyxy_px, every, ~every)


def test_ospa_of_a_half_overlapping_path_and_one_too_many() -> None:
    # Person 7 and track 1: overlaps 1 and 1/2, so the distance is (0 + 1/2) / 2 = 1/4. Track 2 is
    # one too many: (1 + 1/4) / max(1, 2) = 0.625.
    annotated = [truth((7, [0, 0, 10, 10])), truth((7, [0, 0, 10, 10]))]
    found = [tracks((1, [0, 0, 10, 10])), tracks((1, [0, 0, 10, 20]), (2, [90, 0, 99, 9]))]
    assert ospa(annotated, found) == pytest.approx(0.625)


def test_ospa_counts_a_frame_of_one_path_alone_as_1() -> None:
    # The track misses the second of the person's frames and adds a third: (0 + 1 + 1) / 3.
    annotated = [truth((7, [0, 0, 10, 10])), truth((7, [0, 0, 10, 10])), truth()]
    found = [tracks((1, [0, 0, 10, 10])), tracks(), tracks((1, [0, 0, 10, 10]))]
    assert ospa(annotated, found) == pytest.approx(2 / 3)


def test_ospa_of_equal_paths_is_0_and_of_an_identity_switch_is_not() -> None:
    box = [0.0, 0.0, 10.0, 10.0]
    annotated = [truth((7, box)), truth((7, box))]
    assert ospa(annotated, [tracks((1, box)), tracks((1, box))]) == 0.0
    # Each half path differs by 1/2, and one of them is too many: (1 + 1/2) / 2.
    assert ospa(annotated, [tracks((1, box)), tracks((2, box))]) == pytest.approx(0.75)


def test_fully_occluded_people_are_not_evaluated_but_tracks_on_them_count(tmp_path: Path) -> None:
    write_jrdb(tmp_path)
    sequences = list(JRDB.sequences(tmp_path))
    assert sequences[-1] == f"{TRAINING}/{NAME}"
    job = DatasetJob(tmp_path, sequences[-1], read_method("image-sort-dynamic"), tmp_path)
    result = JRDB.evaluate(job)
    assert result.figures is not None
    row = result.figures.row()
    # One of two tracks is one too many, 1/2; filtered boxes of the other differ a little.
    assert row["ospa"] is not None
    assert 0.5 <= row["ospa"] < 0.6
    assert (row["misses"], row["false_alarms"], row["id_switches"]) == (0, len(lab_people()), 0)
    both = result.figures + result.figures
    assert both.row()["ospa"] == pytest.approx(row["ospa"])


def test_a_submission_is_numbered_in_its_split(tmp_path: Path) -> None:
    write_jrdb(tmp_path)
    job = DatasetJob(tmp_path, f"{TEST}/{NAME}", read_method("image-sort-dynamic"), tmp_path)
    result = JRDB.evaluate(job)
    assert result.figures is None
    rows = [line.split() for line in result.submission[f"{TEST}/0001.txt"].splitlines()]
    assert {len(row) for row in rows} == {18}
    assert rows[0][:6] == ["0", "1", "Pedestrian", "0", "0", "-1"]
    assert tuple(map(float, rows[0][6:10])) == lab_people()[0][0].box_px


def test_half_a_download_is_named(tmp_path: Path) -> None:
    (write_jrdb(tmp_path) / TRAINING / FILES["labels"] / f"{NAME}.json").unlink()
    with pytest.raises(SourceError, match=rf"expected {NAME}.json, got an empty folder"):
        JRDB.sequences(tmp_path)


def test_labels_in_3d_are_refused(tmp_path: Path) -> None:
    write_jrdb(tmp_path)
    write(tmp_path, TRAINING, "labels", {"000000.pcd": [{"box": {"cx": 1.0}, "label_id": "p:1"}]})
    with pytest.raises(SourceError, match=rf"{NAME}.json: expected labels of images, got Expected"):
        JRDB.load(tmp_path, f"{TRAINING}/{NAME}")


def test_labels_of_another_sequence_are_refused(tmp_path: Path) -> None:
    write_jrdb(tmp_path)
    write(tmp_path, TRAINING, "labels", {"000900.jpg": []})
    with pytest.raises(SourceError, match=r"expected images of .*, got 000900.jpg"):
        JRDB.load(tmp_path, f"{TRAINING}/{NAME}")
