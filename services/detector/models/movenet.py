"""MoveNet MultiPose: people as centres on a grid, each with a box and 17 keypoints.

The network works as CenterNet [Zhou 2019b]: a heat map of person centres; at each centre the
box and a first guess of the keypoints; a heat map per keypoint, read near that guess; and offsets
below the grid's step. Cut at these raw heads, it has no limit of six people.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from common.geometry.boxes import iou_xyxy
from common.inference.session import Array
from people4d.messages import F32, F64
from services.detector.models.base import DetectedPerson, Limits
from services.detector.models.letterbox import Letterbox
from services.detector.models.network import NetworkModel, Outputs, check_output
from services.detector.models.scores import ScoreCalibration

STRIDE = 4  # [px] of the input per cell of the heads
PEAK_CELLS = 5  # a centre is the highest of so many cells around it
CENTRES_PER_PERSON = 3  # peaks that are read, for each person that may be returned
KEYPOINT_MIN = 0.127  # confidence above which the original counts a keypoint
SPREAD = 0.3  # variance of the keypoint search, a fraction of the grid's shorter side, halved

# Of 228 people marked by hand in real frames, 256x320 finds 207 at a least score of 0.05, with 6
# boxes on no mark, 4 of them on heads of marked people; 208 at 0.03 (8), 195 at 0.10 (1). At
# 320x416 false boxes set in earlier: take 0.15 there (194, none).
SCORE_MIN = 0.05
CALIBRATION = ScoreCalibration(midpoint=0.059, slope=4.7)  # benchmarks/score_calibration.md
IOU_MAX = 0.6
SIMILARITY_MAX = 0.5  # two people side by side stay below 0.4, two centres on one body are above
# Spread of people's labels per COCO keypoint, as a fraction of the person's size.
LABEL_MM = [26, 25, 25, 35, 35, 79, 79, 72, 72, 62, 62, 107, 107, 87, 87, 89, 89]
LABEL_SPREAD = np.array(LABEL_MM) / 1e3

HEADS = {"center": 1, "box_scale": 2, "box_offset": 2}  # channels
HEADS |= {"kpt_heatmap": 17, "kpt_regress": 34, "kpt_offset": 34}


@dataclass(frozen=True)
class MoveNetCandidates:
    """People read from the heads, in pixels of the network's input, best centre first."""

    scores: F64  # N
    boxes: F64  # Nx4 xyxy
    keypoints: F64  # Nx17x3 x, y, confidence


class MoveNet(NetworkModel):
    """MoveNet MultiPose on a network cut at its raw heads."""

    kind = "movenet"
    default_size = (256, 320)
    default_limits = (SCORE_MIN, IOU_MAX)
    calibration = CALIBRATION
    grey, highest = 0, 255.0

    def _check(self, outputs: Outputs) -> None:
        height, width = (side // STRIDE for side in self._input.size)
        for head, channels in HEADS.items():
            check_output(outputs, head, (1, channels, height, width), self.name)

    def _people(self, outputs: Outputs, letterbox: Letterbox) -> list[DetectedPerson]:
        candidates = decode(outputs, self._limits)
        return [to_person(candidates, k, letterbox) for k in select(candidates, self._limits)]


def decode(heads: Outputs, limits: Limits) -> MoveNetCandidates:
    """Read the people from the heads (1xCxHxW each); some may be there twice.

    A person's score is that of the centre times the mean of the confident keypoints, so centres
    below the least score need not be read.
    """
    rows, columns, scores = find_centres(heads["center"][0, 0], limits.score_min)
    best = np.argsort(-scores, kind="stable")[: CENTRES_PER_PERSON * limits.max_people]
    rows, columns, scores = rows[best], columns[best], scores[best]
    boxes = read_boxes(heads, rows, columns)
    keypoints = np.zeros((len(rows), 17, 3))
    for index, (row, column) in enumerate(zip(rows, columns, strict=True)):
        keypoints[index] = read_keypoints(heads, row, column, boxes[index])
    confident = keypoints[:, :, 2] > KEYPOINT_MIN
    total = (keypoints[:, :, 2] * confident).sum(axis=1)
    means = total / np.maximum(confident.sum(axis=1), 1)
    return MoveNetCandidates(scores * means, boxes * STRIDE, keypoints * (STRIDE, STRIDE, 1))


def find_centres(logits: Array, score_min: float) -> tuple[Array, Array, F64]:
    """Return rows, columns and scores of the peaks of the centre map (HxW)."""
    heat = sigmoid(logits)
    around = cv2.dilate(heat, np.ones((PEAK_CELLS, PEAK_CELLS), np.uint8))
    rows, columns = np.nonzero((heat >= around) & (heat >= score_min))
    return rows, columns, heat[rows, columns].astype(np.float64)


def read_boxes(heads: Outputs, rows: Array, columns: Array) -> F64:
    """Return the boxes (Nx4 xyxy, in cells) at the given centres, clipped to the grid.

    Against true boxes they have a median overlap of 0.95; the extent of the keypoints has 0.67.
    """
    offset = heads["box_offset"][0][:, rows, columns].astype(np.float64)
    height, width = np.maximum(heads["box_scale"][0][:, rows, columns], 0)
    y, x = rows + offset[0], columns + offset[1]
    boxes = np.stack([x - width / 2, y - height / 2, x + width / 2, y + height / 2], axis=1)
    grid_height, grid_width = heads["center"].shape[2:]
    clipped: F64 = np.clip(boxes, 0, [grid_width, grid_height, grid_width, grid_height])
    return clipped


def read_keypoints(heads: Outputs, row: int, column: int, box: F64) -> F64:
    """Return 17x3 (x, y in cells, confidence) of the person centred at a cell.

    Each keypoint is the cell inside the box where heat times nearness to the regressed guess is
    largest; that product is its confidence.
    """
    left, top, right, bottom = np.ceil(box).astype(int)
    if right <= left or bottom <= top:
        return np.zeros((17, 3))
    guess = np.array([row, column]) + heads["kpt_regress"][0, :, row, column].reshape(17, 2)
    variance = SPREAD * min(heads["center"].shape[2:])
    near_y = np.exp(-((np.arange(top, bottom) - guess[:, :1]) ** 2) / variance)
    near_x = np.exp(-((np.arange(left, right) - guess[:, 1:]) ** 2) / variance)
    heat = sigmoid(heads["kpt_heatmap"][0, :, top:bottom, left:right])
    heat *= near_y[:, :, None] * near_x[:, None, :]
    flat = heat.reshape(17, -1)
    best = flat.argmax(axis=1)
    rows, columns = top + best // (right - left), left + best % (right - left)
    each = np.arange(17)
    offsets = heads["kpt_offset"][0].reshape(17, 2, *heads["center"].shape[2:])
    offset = offsets[each, :, rows, columns]
    return np.stack([columns + offset[:, 1], rows + offset[:, 0], flat[each, best]], axis=1)


def select(candidates: MoveNetCandidates, limits: Limits) -> list[int]:
    """Return the candidates that are people, each once, best first."""
    selected: list[int] = []
    overlap = iou_xyxy(candidates.boxes, candidates.boxes)
    for index in np.argsort(-candidates.scores, kind="stable"):
        if candidates.scores[index] < limits.score_min or len(selected) == limits.max_people:
            break
        if selected and overlap[index, selected].max() > limits.iou_max:
            continue
        if all(similarity(candidates, index, other) <= SIMILARITY_MAX for other in selected):
            selected.append(int(index))
    return selected


def similarity(candidates: MoveNetCandidates, one: int, other: int) -> float:
    """Return the similarity of two people's keypoints: 1 the same, 0 apart (COCO's OKS).

    Two centres on one body give boxes that overlap little but the same keypoints.
    """
    pair = [one, other]
    confident = (candidates.keypoints[pair, :, 2] > KEYPOINT_MIN).all(axis=0)
    if not confident.any():
        return 0.0
    sides = candidates.boxes[pair, 2:] - candidates.boxes[pair, :2]
    area = max(sides.prod(axis=1).min(), 1.0)
    apart = np.subtract(*candidates.keypoints[pair, :, :2])
    exponent = (apart**2).sum(axis=1) / (2 * area * (2 * LABEL_SPREAD) ** 2)
    return float(np.exp(-exponent[confident]).mean())


def to_person(candidates: MoveNetCandidates, index: int, letterbox: Letterbox) -> DetectedPerson:
    """Return a candidate in pixels of the image."""
    keypoints = candidates.keypoints[index].copy()
    keypoints[:, :2] = letterbox.to_image(keypoints[:, :2])
    return DetectedPerson(
        score=float(candidates.scores[index]),
        box_xyxy_px=letterbox.to_image(candidates.boxes[index]).astype(np.float32),
        keypoints=keypoints.astype(np.float32),
    )


def sigmoid(logits: Array) -> F32:
    """Return 1 / (1 + exp(-x))."""
    return np.asarray(1 / (1 + np.exp(-logits.astype(np.float32))), np.float32)
