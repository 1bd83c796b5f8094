"""YOLO in the layouts of Ultralytics' exports: people from boxes, with keypoints or without.

One column per box, in pixels of the network's input: centre x, y, width, height, the classes'
scores, then 17 keypoints (x, y, confidence) or 32 mask coefficients. Networks with NMS inside
(nms=True) or without need of NMS (YOLO26, YOLOv10) have one row per box: left, top, right, bottom,
score, class, then the same.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from common.geometry.boxes import nms
from common.inference.session import Array
from people4d.errors import ModelError
from people4d.messages import F32
from services.detector.models.base import DetectedPerson, Limits
from services.detector.models.letterbox import Letterbox
from services.detector.models.network import NetworkModel, Outputs
from services.detector.models.scores import ScoreCalibration

GREY = 114  # value of the bars in the networks' training
DEFAULT_SIZE = (480, 640)
SCORE_MIN = 0.25
# Maximum overlap of two people: in crowded frames, boxes with more have the same keypoints
IOU_MAX = 0.6
POSE_CALIBRATION = ScoreCalibration(midpoint=0.212, slope=2.7)
BOXES_PER_PERSON = 30  # maximum number of boxes to compare, for each person

BOX_ROWS = 4
KEYPOINT_ROWS = 17 * 3
SELECTED_COLUMNS = BOX_ROWS + 2  # before keypoints or coefficients of networks with NMS inside
PERSON = 0  # index of the class "person"


@dataclass(frozen=True)
class YoloCandidates:
    """People in pixels of the network's input, best first, without duplicates."""

    scores: F32  # N
    boxes: F32  # Nx4 xyxy
    extras: F32  # NxE: keypoints or mask coefficients


class YoloBoxes(NetworkModel):
    """Boxes without keypoints or masks, for networks of keypoints in boxes."""

    kind = "yolo-boxes"
    default_size = DEFAULT_SIZE
    default_limits = (SCORE_MIN, IOU_MAX)
    calibration = POSE_CALIBRATION
    grey, highest = GREY, 1.0
    extras: ClassVar[int] = 0  # number of values of a box after its scores
    classes_max: ClassVar[int] = 1000  # maximum number of classes
    layout: ClassVar[str] = "1x(4+classes)xN or 1xNx6"  # shapes of the outputs, for errors

    def _check(self, outputs: Outputs) -> None:
        self._boxes = next((name for name, array in outputs.items() if array.ndim == 3), "")
        boxes = outputs.get(self._boxes)
        self._selected = is_selected(boxes, self.extras)
        rows = 0 if boxes is None else boxes.shape[1]
        self._classes = 1 if self._selected else rows - BOX_ROWS - self.extras
        if not 1 <= self._classes <= self.classes_max:
            raise self._unknown(outputs)

    def _unknown(self, outputs: Outputs) -> ModelError:
        got = ", ".join(f"{name} {array.shape}" for name, array in outputs.items())
        return ModelError(f"{self.name}: expected outputs {self.layout}, got {got}")

    def _people(self, outputs: Outputs, letterbox: Letterbox) -> list[DetectedPerson]:
        found = self._candidates(outputs)
        boxes = letterbox.to_image(found.boxes).astype(np.float32)
        return list(map(DetectedPerson, found.scores.tolist(), boxes))

    def _candidates(self, outputs: Outputs) -> YoloCandidates:
        """Pick the people from all boxes."""
        boxes: Array = outputs[self._boxes][0]
        columns = columns_of(boxes) if self._selected else boxes
        return decode(columns, self._classes, self._limits)


class YoloPose(YoloBoxes):
    """17 keypoints per box."""

    kind = "yolov8-pose"
    extras = KEYPOINT_ROWS
    classes_max = 1
    layout = "1x56xN or 1xNx57"

    def _people(self, outputs: Outputs, letterbox: Letterbox) -> list[DetectedPerson]:
        found = self._candidates(outputs)
        return [pose_person(found, index, letterbox) for index in range(len(found.scores))]


def is_selected(output: Array | None, extras: int) -> bool:
    """Check for the output of a network with NMS inside: 1xNx(6 + extras)."""
    return output is not None and output.ndim == 3 and output.shape[2] == SELECTED_COLUMNS + extras


def columns_of(rows: Array) -> F32:
    """Return rows of a network with NMS inside in the column layout, with one class."""
    numbers = rows.astype(np.float32)
    first, last, extras = numbers[:, :2], numbers[:, 2:BOX_ROWS], numbers[:, SELECTED_COLUMNS:]
    score = numbers[:, BOX_ROWS] * (numbers[:, BOX_ROWS + 1] == PERSON)
    columns: F32 = np.column_stack([(first + last) / 2, last - first, score, extras]).T
    return columns


def decode(columns: Array, classes: int, limits: Limits) -> YoloCandidates:
    """Pick the people from all boxes (RxN, one column a box); the first class is "person"."""
    scores = columns[BOX_ROWS]
    likely = np.flatnonzero(scores >= limits.score_min)
    if classes > 1:
        best = columns[BOX_ROWS : BOX_ROWS + classes, likely].max(axis=0)
        likely = likely[scores[likely] >= best]
    most = limits.max_people * BOXES_PER_PERSON
    likely = likely[np.argsort(-scores[likely], kind="stable")[:most]]
    rows = columns[:, likely].T.astype(np.float32)
    half = rows[:, 2:4] / 2
    boxes = np.hstack([rows[:, :2] - half, rows[:, :2] + half]).astype(np.float32)
    selected = nms(boxes, rows[:, BOX_ROWS], limits.iou_max)[: limits.max_people]
    return YoloCandidates(
        rows[selected, BOX_ROWS], boxes[selected], rows[selected, BOX_ROWS + classes :]
    )


def pose_person(found: YoloCandidates, index: int, letterbox: Letterbox) -> DetectedPerson:
    """Return a person with keypoints in pixels of the image."""
    keypoints = found.extras[index].reshape(17, 3).copy()
    keypoints[:, :2] = letterbox.to_image(keypoints[:, :2])
    return DetectedPerson(
        score=float(found.scores[index]),
        box_xyxy_px=letterbox.to_image(found.boxes[index]).astype(np.float32),
        keypoints=keypoints,
    )
