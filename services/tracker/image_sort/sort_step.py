"""One frame of SORT in the image as compiled code; `step` reads as the published method."""

from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from people4d.messages import F64
from services.tracker.image_sort.box_assignment import I64, assign, iou
from services.tracker.image_sort.box_kalman import begin, correct, predict
from services.tracker.image_sort.camera_turn import Lens, Turn, turn_track

NONE = -1
ENDED = 2**62  # missed frames of a track that ends without another association
BOOL = npt.NDArray[np.bool_]
Records: TypeAlias = npt.NDArray[Any]  # of box_kalman.TRACK


class SortSettings(NamedTuple):
    """Constants of the method."""

    iou_min: float
    score_high: float
    score_new: float
    min_hits: int
    streak: bool
    t_lost: float
    r: float
    max_age: float
    lost_max_ns: float


class BoxDetections(NamedTuple):
    """Detections of one frame."""

    stamp_ns: int
    boxes: F64
    scores: F64
    steps: float  # [frames] since the last one


class TrackTable(NamedTuple):
    """All tracks, and the counts of identities and frames."""

    tracks: Records  # room for all tracks and one more per detection
    size: int  # number of tracks
    next_id: int
    frames: int


@compiled
def step(
    table: TrackTable, found: BoxDetections, turn: Turn, lens: Lens, settings: SortSettings
) -> tuple[int, int, I64, F64, F64, I64]:
    """Correct ego motion, predict, associate, update; begin and end tracks.

    Returns:
        Number of tracks, next identity, and the columns of `BoxTracks`.
    """
    tracks, boxes = table.tracks, found.boxes
    for i in range(table.size):
        track = tracks[i]
        if turn.rad != 0 or turn.up_rad != 0 or turn.sigma_rad != 0:
            turn_track(track, turn, lens)
        predict(track, found.steps)
        track.detection = NONE
        unmatched_ns = found.stamp_ns - track.matched_ns
        track.missed = track.missed + 1 if unmatched_ns <= settings.lost_max_ns else ENDED
    free = _usable(found)
    high = free & (found.scores >= settings.score_high)
    _match(tracks[: table.size], boxes, high, settings.iou_min, ENDED - 1)
    if settings.score_high > 0:
        low = free & (found.scores < settings.score_high)
        _match(tracks[: table.size], boxes, low, settings.iou_min, 1)
    count = 0
    for i in range(table.size):
        if tracks[i].detection != NONE:
            free[tracks[i].detection] = False
            correct(tracks[i], boxes[tracks[i].detection])
        _count(tracks[i], found, settings)
        if _survives(tracks[i], settings):
            tracks[count] = tracks[i]
            count += 1
    next_id = table.next_id
    for j in range(len(boxes)):
        if free[j] and found.scores[j] >= settings.score_new:
            _begin(tracks[count], next_id, j, found, settings)
            count += 1
            next_id += 1
    ids, boxes_xyxy_px, scores, detections = _published(tracks[:count], table.frames, settings)
    return count, next_id, ids, boxes_xyxy_px, scores, detections


@compiled
def _usable(found: BoxDetections) -> BOOL:
    """Return the detections that have a score and a box with an area."""
    usable = np.empty(len(found.boxes), np.bool_)
    for j in range(len(found.boxes)):
        left, top, right, bottom = found.boxes[j]
        area = (right - left) * (bottom - top)  # finite only if all four are
        usable[j] = left < right and top < bottom and area < np.inf and found.scores[j] >= 0
    return usable


@compiled
def _match(tracks: Records, boxes: F64, free: BOOL, iou_min: float, missed_max: int) -> None:
    """Assign detections (M, those that are free) to tracks at the largest sum of overlaps.

    Pairs that overlap less than `iou_min` are refused; tracks with a detection already, or
    unmatched for more than `missed_max` frames, this one included, take no part.
    """
    rows, columns = np.empty(len(tracks), np.int64), np.flatnonzero(free)
    n = 0
    for i in range(len(tracks)):
        if tracks[i].detection == NONE and tracks[i].missed <= missed_max:
            rows[n] = i
            n += 1
    gain = np.zeros((n, len(columns)))
    for a in range(n):
        for b in range(len(columns)):
            overlap = iou(tracks[rows[a]].box, boxes[columns[b]])
            if overlap >= iou_min:
                gain[a, b] = overlap
    column_of = assign(gain)
    for a in range(n):
        if column_of[a] != NONE:
            tracks[rows[a]].detection = columns[column_of[a]]


@compiled
def _count(track: Any, found: BoxDetections, settings: SortSettings) -> None:
    if track.detection == NONE:
        track.streak = 0
        return
    track.score = found.scores[track.detection]
    track.matched_ns = found.stamp_ns
    track.hits += 1
    track.streak += 1
    track.missed = 0
    track.confirmed |= track.streak >= settings.min_hits


@compiled
def _survives(track: Any, settings: SortSettings) -> bool:
    """Check that a track survives: T_age = min(T_lost + T_hits / R, max_age)."""
    t_age = min(settings.t_lost + track.hits / settings.r, settings.max_age)
    finite = np.isfinite(track.box[0] + track.box[1] + track.box[2] + track.box[3])
    return bool(track.missed <= t_age and finite)


@compiled
def _begin(track: Any, identity: int, j: int, found: BoxDetections, settings: SortSettings) -> None:
    begin(track, found.boxes[j])
    track.id = identity
    track.detection = j
    track.score = found.scores[j]
    track.matched_ns = found.stamp_ns
    track.hits = 1
    track.streak = track.missed = 0
    track.confirmed = settings.min_hits == 0


@compiled
def _published(tracks: Records, frames: int, settings: SortSettings) -> tuple[I64, F64, F64, I64]:
    """Return the columns of `BoxTracks`: confirmed and matched tracks."""
    n = 0
    ids, detections = np.empty(len(tracks), np.int64), np.empty(len(tracks), np.int64)
    boxes, scores = np.empty((len(tracks), 4)), np.empty(len(tracks))
    for i in range(len(tracks)):
        track = tracks[i]
        confirmed = track.streak >= settings.min_hits if settings.streak else track.confirmed
        if track.detection != NONE and (confirmed or frames <= settings.min_hits):
            ids[n], detections[n], scores[n] = track.id, track.detection, track.score
            for k in range(4):
                boxes[n, k] = track.box[k]
            n += 1
    return ids[:n], boxes[:n], scores[:n], detections[:n]
