"""OSPA(2) of paths of boxes, as the toolkit of JRDB computes it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from common.geometry.boxes import iou_xyxy
from common.metrics.counts import Counts
from common.metrics.scores import Row, Scores
from evaluation.datasets.boxes import BoxTruth
from services.tracker.image_sort.image_sort import BoxTracks


@dataclass(frozen=True)
class OspaFigures(Counts):
    """OSPA, which is a mean over sequences, and all other figures."""

    scores: Scores
    ospa: float  # sum over sequences
    sequences: int = 1

    def row(self) -> Row:
        """Return all figures by name."""
        return {"ospa": self.ospa / self.sequences} | self.scores.row()


def ospa(truth: Sequence[BoxTruth], tracks: Sequence[BoxTracks]) -> float:
    """Return OSPA(2) of the tracks of each frame: 0 for the same paths, 1 for nothing in common.

    The distance of two paths is the mean of 1 - IoU over the frames of either path; a frame of only
    one path counts 1. Paths are assigned at the least sum of distances; a surplus path counts 1.
    """
    people = {one: k for k, one in enumerate(sorted({i for t in truth for i in t.people[0]}))}
    found = {one: k for k, one in enumerate(sorted({i for t in tracks for i in t.ids.tolist()}))}
    shape = len(people), len(found)
    if not max(shape):
        return 0.0
    total, frames = np.zeros(shape), np.zeros(shape)
    for annotated, tracked in zip(truth, tracks, strict=True):
        ids, boxes = annotated.people
        rows, columns = [people[i] for i in ids], [found[i] for i in tracked.ids.tolist()]
        either = np.zeros(shape)
        either[rows], either[:, columns] = 1.0, 1.0
        frames += either
        either[np.ix_(rows, columns)] = 1.0 - iou_xyxy(boxes, tracked.boxes_xyxy_px)
        total += either
    distance = total / np.maximum(frames, 1.0)
    cost = distance[linear_sum_assignment(distance)].sum()
    return float((abs(shape[0] - shape[1]) + cost) / max(shape))
