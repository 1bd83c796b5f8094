"""The models on real and simulated images with known people."""

from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from rosbags.highlevel import AnyReader

from common.geometry.boxes import iou_xyxy
from people4d.messages import F64, U8
from services.detector.config import ModelSettings
from services.detector.models.base import DetectedPerson, PersonModel
from services.detector.models.registry import load_model
from tests.two_people import truth_of

LEFT, RIGHT = 5, 6  # shoulders in COCO order
YOLO = ["yolov8n-pose_640", "yolov8n-seg_640"]
ALL = ["movenet-multipose", *YOLO]


@cache
def model(name: str, shared: Path) -> PersonModel:
    path = shared / "data" / "models" / f"{name}.onnx"
    return load_model(ModelSettings(model=str(path) if name in YOLO else name))


def read(path: Path) -> U8:
    image = cv2.imread(str(path))
    assert image is not None
    return np.ascontiguousarray(image[..., ::-1])


def bag_image(path: Path) -> U8:
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message: Any = reader.deserialize(raw, connection.msgtype)
            if getattr(message, "encoding", "") == "rgb8":
                pixels: U8 = message.data.reshape(message.height, message.width, 3)
                return pixels
    raise AssertionError(f"{path} has no colour image")


def boxes(people: list[DetectedPerson]) -> npt.NDArray[np.float32]:
    return np.array([person.box_xyxy_px for person in people]).reshape(-1, 4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_nine_people(shared: Path, name: str) -> None:
    image = read(shared / "data" / "rgbd" / "tue" / "example.jpg")
    assert len(model(name, shared).detect(image)) == 9


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_man_in_front_is_found_once_in_every_bag(shared: Path, name: str) -> None:
    bags = sorted((shared / "data" / "rgbd" / "tue").glob("*.bag"))
    assert len(bags) == 5
    for bag in bags:
        found = boxes(model(name, shared).detect(bag_image(bag)))
        tall = found[found[:, 3] - found[:, 1] > 350]
        # The person stands in the middle, head at the top, down to the lower edge.
        middle = tall[(tall[:, 0] < 320) & (tall[:, 2] > 320)]
        assert len(middle) == 1
        assert middle[0, 1] < 80
        assert middle[0, 3] > 460


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_simulated_people_are_found_where_they_are(shared: Path, name: str) -> None:
    folder = shared / "data" / "lab" / "two"
    names = ("vis", "kpvis", "kp2d", "bbox", "masks")
    truth = {name: truth_of(shared, name) for name in names}
    overlaps = []
    for frame in range(0, 150, 30):
        people = model(name, shared).detect(read(folder / "rgb" / f"{frame:05d}.jpg"))
        visible = truth["bbox"][frame][truth["vis"][frame] > 0.3]
        overlap = iou_xyxy(visible, boxes(people))
        assert len(people) == len(visible)
        overlaps += overlap.max(axis=1).tolist()
        for person in people:
            check_person(person, truth, frame)
    assert min(overlaps) > 0.6
    assert np.median(overlaps) > 0.9


def check_person(person: DetectedPerson, truth: Any, frame: int) -> None:
    """Compare keypoints or mask with the truth of the person with the best box."""
    who = int(iou_xyxy(person.box_xyxy_px, truth["bbox"][frame]).argmax())
    if person.keypoints is not None:
        visible = (person.keypoints[:, 2] > 0.4) & (truth["kpvis"][frame, who] > 0)
        apart = person.keypoints[visible, :2] - truth["kp2d"][frame, who][visible]
        assert np.median(np.linalg.norm(apart, axis=1)) < 8
        check_sides(person.keypoints[:, :2], truth["kp2d"][frame, who])
    if person.mask is not None:
        assert mask_overlap(person, truth["masks"][frame] == who + 1) > 0.75


def check_sides(found: npt.NDArray[np.float32], true: F64) -> None:
    """Check that left and right shoulder are not exchanged, unless the body is seen from a side."""
    width = true[LEFT, 0] - true[RIGHT, 0]
    if abs(width) > 20:
        assert np.sign(found[LEFT, 0] - found[RIGHT, 0]) == np.sign(width)


def mask_overlap(person: DetectedPerson, true: npt.NDArray[np.bool_]) -> float:
    assert person.mask is not None
    found = np.zeros_like(true)
    height, width = person.mask.window.shape
    x, y = person.mask.x_px, person.mask.y_px
    found[y : y + height, x : x + width] = person.mask.window > 0
    return float((found & true).sum() / (found | true).sum())
