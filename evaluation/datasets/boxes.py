"""Boxes in images: trackers without depth, and truth as the MOT-Challenge and KITTI define it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.geometry.boxes import iou_xyxy
from common.metrics.mot_text import MotInfo, MotRows
from common.metrics.record import BOOL, EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses
from common.metrics.scores import Scores, score
from common.metrics.similarity import box_overlap
from evaluation.methods import Method
from people4d.errors import ConfigError
from people4d.messages import F64
from services.tracker.image_sort.image_sort import BoxFrame, BoxTracks, ImageSort

MATCH_IOU = 0.5  # minimum overlap of a track with a box that is not evaluated; TrackEval


@dataclass(frozen=True)
class BoxTruth:
    """Annotated boxes of one frame, N rows."""

    ids: tuple[int, ...]
    boxes_xyxy_px: F64  # Nx4
    evaluated: BOOL  # N: people that must be tracked
    neutral: BOOL  # N: a track on such a box counts neither for nor against


def image_frame(rows: MotRows, number: int, info: MotInfo) -> BoxFrame:
    """Return the detections of one frame, which are numbered from 1."""
    stamp_ns, size_px = round((number - 1) * 1e9 / info.rate_hz), (info.width, info.height)
    return BoxFrame(stamp_ns, rows.boxes_xyxy_px, rows.confidences, size_px)


def detection_rows(frames: Sequence[BoxFrame]) -> F64:
    """Return the detections of all frames: frame from 1, left, top, right, bottom, score."""
    return np.vstack(
        [
            np.column_stack([np.full(len(one.scores), number), one.boxes_xyxy_px, one.scores])
            for number, one in enumerate(frames, 1)
        ]
    )


def track_boxes(method: Method, frames: Sequence[BoxFrame]) -> list[BoxTracks]:
    """Return the tracks of each frame.

    Raises:
        ConfigError: The method needs depth.
    """
    if method.tracker.tracker != "image_sort":
        raise ConfigError(
            f"{method.name}: expected a tracker of boxes, got {method.tracker.tracker}",
            "The data set has no depth: choose a preset whose name begins with image-sort.",
        )
    tracker = ImageSort(method.tracker.image_sort)
    return [tracker.update(frame) for frame in frames]


def score_boxes(
    name: str, frames: Sequence[BoxFrame], truth: Sequence[BoxTruth], tracks: Sequence[BoxTracks]
) -> Scores:
    """Score tracks by the overlap of boxes, after leaving out tracks on neutral boxes."""
    evaluated = [
        EvaluationFrame(
            stamp_ns=frame.stamp_ns,
            truth=GroundTruth(
                ids=tuple(one for one, flag in zip(t.ids, t.evaluated, strict=True) if flag),
                boxes_xyxy_px=t.boxes_xyxy_px[t.evaluated],
            ),
            hypotheses=hypotheses(found, ~on_neutral(t, found.boxes_xyxy_px)),
        )
        for frame, t, found in zip(frames, truth, tracks, strict=True)
    ]
    return score(EvaluationSequence(name, tuple(evaluated)), box_overlap)


def hypotheses(tracks: BoxTracks, counted: BOOL) -> Hypotheses:
    """Return the counted tracks (mask of N) of a frame."""
    ids = tuple(tracks.ids[counted].tolist())
    return Hypotheses(ids=ids, boxes_xyxy_px=tracks.boxes_xyxy_px[counted])


def on_neutral(truth: BoxTruth, boxes: F64) -> BOOL:
    """Return the mask (M) of boxes (Mx4) that match a neutral box.

    All annotated boxes are assigned at the maximum sum of overlaps, as in TrackEval.
    """
    overlaps = iou_xyxy(truth.boxes_xyxy_px, boxes)
    admissible = overlaps >= MATCH_IOU - np.finfo(np.float64).eps
    rows, columns = linear_sum_assignment(np.where(admissible, overlaps, 0.0), maximize=True)
    matched = np.zeros(len(boxes), np.bool_)
    matched[columns[admissible[rows, columns] & truth.neutral[rows]]] = True
    return matched
