"""MoveNet MultiPose: people as centres on a grid, each with a box and 17 keypoints.

The network works as CenterNet [Zhou 2019b]: a heat map of person centres; at each centre the
box and a first guess of the keypoints; a heat map per keypoint, read near that guess; and offsets
below the grid's step. Cut at these heads, it has no limit of six people.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from common.geometry.boxes import iou_xyxy
from people4d.messages import F32, F64
from services.detector.models.base import DetectedPerson, Limits
from services.detector.models.letterbox import Letterbox
from services.detector.models.movenet_heads import Cells, HeadReader, Heads
from services.detector.models.network import NetworkModel, Outputs
from services.detector.models.scores import ScoreCalibration

STRIDE = 4  # [px] of the input per cell of the heads
AROUND = np.ones((5, 5), np.uint8)  # window of a local maximum [cells]
CENTRES_PER_PERSON = 3  # number of decoded peaks per person of `max_people`
KEYPOINT_MIN = 0.127  # minimum confidence of a keypoint, as in the original
EACH = np.arange(17)  # keypoints
AT_CENTRES = ("box_offset", "box_scale", "kpt_regress")  # heads that are read at the centres
SPREAD = 0.3  # ratio of twice the variance of the keypoint search to the grid's shorter side

# Minimum score of a person. Of 228 annotated people in real frames, 256x320 finds 207 at 0.05 with
# 6 false boxes (4 on heads of annotated people), 208 at 0.03 (8 false), 195 at 0.10 (1 false);
# 320x416 finds 194 at 0.15 (none false)
SCORE_MIN = 0.05
CALIBRATION = ScoreCalibration(midpoint=0.059, slope=4.7)
IOU_MAX = 0.6
SIMILARITY_MAX = 0.5  # maximum similarity of two people: people side by side are below 0.4
# Standard deviation s of annotations by COCO keypoint, relative to the person's size [1/1000]
LABEL_MM = [26, 25, 25, 35, 35, 79, 79, 72, 72, 62, 62, 107, 107, 87, 87, 89, 89]
LABEL_SPREAD: F64 = -2 * (2 * np.array(LABEL_MM) / 1e3) ** 2  # -2 (2 s)^2


@dataclass(frozen=True)
class MoveNetCandidates:
    """People read from the heads, in pixels of the network's input, best centre first."""

    scores: F64  # N
    boxes: F64  # Nx4 xyxy
    keypoints: F64  # Nx17x3 x, y, confidence


class MoveNet(NetworkModel):
    """MoveNet MultiPose on a network cut at its heads."""

    kind = "movenet"
    default_size = (256, 320)
    default_limits = (SCORE_MIN, IOU_MAX)
    calibration = CALIBRATION
    grey, highest = 0, 255.0

    def _check(self, outputs: Outputs) -> None:
        height, width = (side // STRIDE for side in self._input.size)
        self._reader = HeadReader(outputs, height, width, self.name)

    def _people(self, outputs: Outputs, letterbox: Letterbox) -> list[DetectedPerson]:
        candidates = decode(self._reader.heads(outputs), self._limits)
        return to_people(candidates, select_people(candidates, self._limits), letterbox)


def decode(heads: Heads, limits: Limits) -> MoveNetCandidates:
    """Read the people from the heads, possibly with duplicates.

    A person's score is the centre's score times the mean confidence of its confident keypoints, so
    centres below the minimum score are not read.
    """
    rows, columns, scores = find_centres(heads.center, limits.score_min)
    best = (-scores).argsort(kind="stable")[: CENTRES_PER_PERSON * limits.max_people]
    rows, columns, scores = rows[best], columns[best], scores[best]
    offset, size, regressed = heads.read(AT_CENTRES, rows, columns)
    boxes = boxes_at(rows, columns, offset, size, heads.center.shape)
    guesses = np.stack([rows, columns], axis=1)[:, None] + np.float64(regressed.reshape(-1, 17, 2))
    keypoints = read_keypoints(heads, guesses, boxes)
    confident = keypoints[:, :, 2] > KEYPOINT_MIN
    total = (keypoints[:, :, 2] * confident).sum(axis=1)
    means = total / np.maximum(confident.sum(axis=1), 1)
    return MoveNetCandidates(scores * means, boxes * STRIDE, keypoints * (STRIDE, STRIDE, 1))


def find_centres(heat: F32, score_min: float) -> tuple[Cells, Cells, F64]:
    """Return rows, columns and scores of the peaks of the centre map (HxW)."""
    around = cv2.dilate(heat, AROUND)
    peaks = np.flatnonzero(heat >= np.maximum(around, np.float32(score_min)))
    rows, columns = np.divmod(peaks, heat.shape[1])
    return rows, columns, heat[rows, columns].astype(np.float64)


def boxes_at(rows: Cells, columns: Cells, offset: F32, size: F32, grid: tuple[int, ...]) -> F64:
    """Return the boxes (Nx4 xyxy, in cells) at the given centres, clipped to the grid.

    Against true boxes they have a median overlap of 0.95; the extent of the keypoints has 0.67.
    """
    middle = np.stack([columns, rows], axis=1) + offset[:, ::-1].astype(np.float64)
    half = np.maximum(size[:, ::-1], 0) / 2
    corners = np.hstack([middle - half, middle + half])
    clipped: F64 = np.minimum(np.maximum(corners, 0), (grid[1], grid[0]) * 2)
    return clipped


def read_keypoints(heads: Heads, guesses: F64, boxes: F64) -> F64:
    """Return Nx17x3 (x, y in cells, confidence) of people with guesses (Nx17x2 row and column).

    Each keypoint is the cell in the box with the largest product of heat and nearness to the
    regressed guess; the product is its confidence, 0 in a box without a cell.
    """
    keypoints = np.zeros((len(boxes), 17, 3))
    height, width = heads.keypoints.shape[1:]
    near_y, near_x = (
        np.exp(
            (np.arange(side) - guesses[..., axis, None]) ** 2 / (-SPREAD * min(height, width))
        ).astype(np.float32)
        for axis, side in enumerate((height, width))
    )
    bounds = np.ceil(boxes).astype(int).tolist()
    found = [
        k for k, (left, top, right, bottom) in enumerate(bounds) if left < right and top < bottom
    ]
    for k in found:
        left, top, right, bottom = bounds[k]
        weighed = heads.keypoints[:, top:bottom, left:right] * near_y[k, :, top:bottom, None]
        weighed *= near_x[k, :, None, left:right]
        flat = weighed.reshape(17, -1)
        best = flat.argmax(axis=1)
        rows, columns = np.divmod(best, right - left)
        own = keypoints[k]
        own[:, 0], own[:, 1], own[:, 2] = columns + left, rows + top, flat[EACH, best]
    cells = keypoints[found, :, 1::-1].astype(np.intp).reshape(-1, 2)
    (offsets,) = heads.read(("kpt_offset",), cells[:, 0], cells[:, 1])
    keypoints[found, :, :2] += offsets.reshape(-1, 17, 17, 2)[:, EACH, EACH, ::-1]
    return keypoints


def select_people(candidates: MoveNetCandidates, limits: Limits) -> list[int]:
    """Select the candidates of different people, highest score first."""
    selected: list[int] = []
    good = np.flatnonzero(candidates.scores >= limits.score_min)
    boxes, keypoints = candidates.boxes[good], candidates.keypoints[good]
    same = iou_xyxy(boxes, boxes) > limits.iou_max
    is_same = (same | (similarities(boxes, keypoints) > SIMILARITY_MAX)).tolist()
    for index in (-candidates.scores[good]).argsort(kind="stable").tolist():
        if len(selected) == limits.max_people:
            break
        if not any(is_same[index][other] for other in selected):
            selected.append(index)
    people: list[int] = good[selected].tolist()
    return people


def similarities(boxes: F64, keypoints: F64) -> F64:
    """Return the similarity of the keypoints of N people, NxN, 0 to 1 (COCO's OKS).

    Two centres on one body give boxes with little overlap but the same keypoints.
    """
    confident = keypoints[:, :, 2] > KEYPOINT_MIN
    both = confident[:, None] & confident
    sides = boxes[:, 2:] - boxes[:, :2]
    areas = np.maximum(sides[:, 0] * sides[:, 1], 1.0)
    apart = keypoints[:, None, :, :2] - keypoints[:, :, :2]
    squared = apart[..., 0] ** 2 + apart[..., 1] ** 2
    near = np.exp(squared / np.minimum(areas[:, None], areas)[..., None] / LABEL_SPREAD) * both
    mean: F64 = near.sum(axis=2) / np.maximum(both.sum(axis=2), 1)
    return mean


def to_people(
    candidates: MoveNetCandidates, chosen: Sequence[int], letterbox: Letterbox
) -> list[DetectedPerson]:
    """Return the chosen candidates in pixels of the image."""
    keypoints = candidates.keypoints[chosen]
    keypoints[..., :2] = letterbox.to_image(keypoints[..., :2])
    boxes = letterbox.to_image(candidates.boxes[chosen]).astype(np.float32)
    scores = candidates.scores[chosen].tolist()
    return list(map(DetectedPerson, scores, boxes, keypoints.astype(np.float32)))
