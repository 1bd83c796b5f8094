"""Boxes in images: trackers without depth, and truth as the MOT-Challenge and KITTI define it."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.geometry.boxes import intersections_xyxy, iou_xyxy
from common.metrics.mot_text import MotInfo, MotRows
from common.metrics.record import BOOL, EvaluationFrame, EvaluationSequence, GroundTruth, Hypotheses
from common.metrics.scores import Scores, score
from common.metrics.similarity import box_overlap
from evaluation.methods import Method
from people4d.errors import ConfigError
from people4d.messages import F64
from services.tracker.image_sort.image_sort import BoxFrame, BoxTracks, ImageSort

# Minimum overlap of a track with an annotated box, minimum share in a region, as in TrackEval
MATCH_IOU, REGION_SHARE = 0.5, 0.5
ROUNDING = np.finfo(np.float64).eps


@dataclass(frozen=True)
class BoxTruth:
    """Annotated boxes of one frame, N rows."""

    ids: tuple[int, ...]
    boxes_xyxy_px: F64  # Nx4
    evaluated: BOOL  # N: people that must be tracked
    neutral: BOOL  # N: a track on such a box counts neither for nor against
    # Kx4: a track on no annotated box counts neither, if mostly in such a region or not this high
    regions_xyxy_px: F64 = field(default_factory=lambda: np.zeros((0, 4)))
    height_min_px: float = 0.0

    @property
    def people(self) -> tuple[tuple[int, ...], F64]:
        """Identities and boxes of the people that must be tracked."""
        ids = tuple(one for one, flag in zip(self.ids, self.evaluated, strict=True) if flag)
        return ids, self.boxes_xyxy_px[self.evaluated]


@dataclass(frozen=True)
class BoxSequence:
    """Detections and truth of one sequence."""

    name: str
    frames: tuple[BoxFrame, ...]
    truth: tuple[BoxTruth, ...] | None  # None: not published

    @property
    def rate_hz(self) -> float:
        """Frame rate."""
        return 1e9 * (len(self.frames) - 1) / (self.frames[-1].stamp_ns - self.frames[0].stamp_ns)

    def score(self, tracks: Sequence[BoxTracks]) -> Scores:
        """Score the tracks of each frame by overlap, without those on neutral boxes."""
        assert self.truth is not None
        evaluated = [
            EvaluationFrame(
                stamp_ns=frame.stamp_ns,
                truth=GroundTruth(ids=truth.people[0], boxes_xyxy_px=truth.people[1]),
                hypotheses=hypotheses(found, ~neutral(truth, found.boxes_xyxy_px)),
            )
            for frame, truth, found in zip(self.frames, self.truth, tracks, strict=True)
        ]
        return score(EvaluationSequence(self.name, tuple(evaluated)), box_overlap)


def image_frame(rows: MotRows, number: int, info: MotInfo) -> BoxFrame:
    """Return the detections of one frame, which are numbered from 1."""
    stamp_ns, size_px = round((number - 1) * 1e9 / info.rate_hz), (info.width, info.height)
    return BoxFrame(stamp_ns, rows.boxes_xyxy_px, rows.confidences, size_px)


def track_boxes(method: Method, frames: Sequence[BoxFrame]) -> list[BoxTracks]:
    """Return the tracks of each frame; ConfigError if the method needs depth."""
    if method.tracker.tracker != "image_sort":
        raise ConfigError(
            f"{method.name}: expected a tracker of boxes, got {method.tracker.tracker}",
            "The data set has no depth: choose a preset whose name begins with image-sort.",
        )
    tracker = ImageSort(method.tracker.image_sort)
    return [tracker.update(frame) for frame in frames]


def hypotheses(tracks: BoxTracks, counted: BOOL) -> Hypotheses:
    """Return the counted tracks (mask of N) of a frame."""
    ids = tuple(tracks.ids[counted].tolist())
    return Hypotheses(ids=ids, boxes_xyxy_px=tracks.boxes_xyxy_px[counted])


def neutral(truth: BoxTruth, boxes: F64) -> BOOL:
    """Return the mask (M) of boxes (Mx4) that count neither for nor against, as in TrackEval.

    All annotated boxes are assigned at the maximum sum of overlaps.
    """
    overlaps = iou_xyxy(truth.boxes_xyxy_px, boxes)
    admissible = overlaps >= MATCH_IOU - ROUNDING
    rows, columns = linear_sum_assignment(np.where(admissible, overlaps, 0.0), maximize=True)
    matched = admissible[rows, columns]
    result = boxes[:, 3] - boxes[:, 1] <= truth.height_min_px + ROUNDING
    result |= (_covered(boxes, truth.regions_xyxy_px) > REGION_SHARE + ROUNDING).any(axis=1)
    result[columns[matched]] = truth.neutral[rows[matched]]
    return np.asarray(result)


def _covered(boxes: F64, regions: F64) -> F64:
    """Return the share (MxK) of boxes (Mx4) inside of regions (Kx4)."""
    areas = np.prod(boxes[:, None, 2:] - boxes[:, None, :2], axis=-1)
    return np.asarray(intersections_xyxy(boxes, regions) / areas)
