"""SORT in the image: box Kalman filter, intersection over union, Hungarian method.

Odometry correction and dynamic survival are settings of it (method book section 7). One frame is
one call of compiled code; `_step` reads as the paper does.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from people4d.messages import F64
from services.tracker.image_sort.box_assignment import I64, assign, iou
from services.tracker.image_sort.box_kalman import TRACK, begin, correct, predict
from services.tracker.image_sort.camera_turn import STILL, Lens, Turn, turn_track
from services.tracker.image_sort.config import ImageSortConfig

FOV_DEG = 69.0  # [deg] of a camera that nobody described: colour of a RealSense D435i
NONE = -1
ENDED = 2**62  # missed frames of a track that ends without choosing again
BOOL = npt.NDArray[np.bool_]
Records: TypeAlias = npt.NDArray[Any]  # of TRACK


@dataclass(frozen=True, slots=True)
class BoxFrame:
    """What a detector found in one image."""

    stamp_ns: int  # [ns] acquisition time, never before that of the last frame
    boxes_xyxy_px: F64  # [px] Nx4; those that are not finite or have no area are left out
    scores: F64  # N, 0 to 1; those that are not finite are left out
    size_px: tuple[int, int] = (640, 480)  # [px] width and height of the image
    turn: Turn = STILL  # of the camera since the last frame
    fov_deg: float = FOV_DEG  # [deg] horizontal field of view, unless the configuration has one


@dataclass(frozen=True, slots=True)
class BoxTracks:
    """The people of one frame, N rows each, ordered by id."""

    ids: I64  # N, from 1, never used again
    boxes_xyxy_px: F64  # [px] Nx4, filtered
    scores: F64  # N, of the detections
    detections: I64  # N, rows of the detections matched in this frame


class ImageMemory(NamedTuple):
    """What outlives a process."""

    stamp_ns: int | None  # [ns] of the last frame
    frames: int  # since the beginning
    tracks: bytes  # of `box_kalman.TRACK`


class _Settings(NamedTuple):
    iou_min: float
    score_high: float
    score_new: float
    min_hits: int
    streak: bool
    t_lost: float
    r: float
    max_age: float
    lost_max_ns: float


class _Sights(NamedTuple):
    stamp_ns: int
    boxes: F64
    scores: F64
    steps: float  # [frames] since the last one


class _Population(NamedTuple):
    tracks: Records  # room for all who are there and all who may come
    known: int  # of them
    next_id: int
    frames: int


class ImageSort:
    """Follows boxes from image to image.

    Args:
        config: The configuration.
    """

    def __init__(self, config: ImageSortConfig) -> None:
        self._config = config
        dynamic = config.survival == "dynamic"
        self._settings = _Settings(
            iou_min=float(config.iou_min),
            score_high=float(config.score_high),
            score_new=float(config.score_new),
            min_hits=config.min_hits,
            streak=config.confirm == "streak",
            t_lost=float(config.t_lost),
            r=float(config.r) if dynamic else math.inf,
            max_age=float(config.max_age) if dynamic else math.inf,
            lost_max_ns=config.lost_max_s * 1e9,
        )
        self._people = _Population(np.zeros(16, TRACK), known=0, next_id=1, frames=0)
        self._stamp_ns: int | None = None

    def update(self, frame: BoxFrame) -> BoxTracks:
        """Take one frame, an empty one too, and return the people seen in it.

        Args:
            frame: The frame; its turn counts only with ego_motion "odometry".

        Raises:
            ValueError: The stamp lies before that of the last frame, or there is not one score for
                each box of four numbers.
        """
        steps = self._steps_to(frame.stamp_ns)
        boxes, scores = _plain(frame.boxes_xyxy_px), _plain(frame.scores)
        if boxes.shape != (*scores.shape, 4):
            raise ValueError(f"boxes, scores: expected Nx4, N, got {boxes.shape}, {scores.shape}")
        tracks, known, next_id, frames = self._people
        room = known + len(boxes)
        if room > len(tracks):
            tracks = np.concatenate([tracks, np.zeros(2 * room - len(tracks), TRACK)])
        turn = frame.turn if self._config.ego_motion == "odometry" else STILL
        known, next_id, ids, shown, told_scores, detections = _step(
            _Population(tracks, known, next_id, frames + 1),
            _Sights(frame.stamp_ns, boxes, scores, steps),
            turn,
            self._lens(frame),
            self._settings,
        )
        self._people = _Population(tracks, known, next_id, frames + 1)
        self._stamp_ns = frame.stamp_ns
        return BoxTracks(ids, shown, told_scores, detections)

    @property
    def tracks(self) -> Records:
        """All who are followed, seen or not, as `box_kalman.TRACK`."""
        return self._people.tracks[: self._people.known].copy()

    @property
    def next_id(self) -> int:
        """The next identity to be given."""
        return self._people.next_id

    def raise_to(self, next_id: int) -> None:
        """Take all identities below a number as given."""
        self._people = self._people._replace(next_id=max(self.next_id, next_id))

    def save(self) -> ImageMemory:
        """Return all that is known of people."""
        return ImageMemory(self._stamp_ns, self._people.frames, self.tracks.tobytes())

    def restore(self, memory: ImageMemory) -> None:
        """Go on with what another one saved.

        Raises:
            ValueError: It cannot be the people of an image.
        """
        if len(memory.tracks) % TRACK.itemsize:
            raise ValueError(f"expected tracks of {TRACK.itemsize} bytes, got {len(memory.tracks)}")
        tracks = np.frombuffer(memory.tracks, TRACK).copy()
        numbers = [tracks[name] for name in ("x", "v", "pp", "pv", "vv", "box", "score")]
        if not all(np.isfinite(column).all() for column in numbers) or (tracks["id"] < 1).any():
            raise ValueError("expected finite numbers and identities >= 1")
        self._people = _Population(tracks, len(tracks), self.next_id, memory.frames)
        self.raise_to(int(tracks["id"].max(initial=0)) + 1)
        self._stamp_ns = memory.stamp_ns

    def postpone(self, duration_ns: int) -> None:
        """Take a time as not passed: nobody looked."""
        if self._stamp_ns is not None:
            self._stamp_ns += duration_ns
        self._people.tracks["seen_ns"] += duration_ns

    def reset(self) -> None:
        """Forget all people and times, but not which identities were given."""
        self._people = self._people._replace(known=0, frames=0)
        self._stamp_ns = None

    def _steps_to(self, stamp_ns: int) -> float:
        if self._stamp_ns is None:
            return 1.0
        if stamp_ns < self._stamp_ns:
            raise ValueError(f"stamp_ns: expected >= {self._stamp_ns}, got {stamp_ns}")
        rate_hz = self._config.rate_hz
        return (stamp_ns - self._stamp_ns) / 1e9 * rate_hz if rate_hz else 1.0

    def _lens(self, frame: BoxFrame) -> Lens:
        width, height = frame.size_px
        own_deg = self._config.fov_deg
        fov_rad = math.radians(frame.fov_deg if own_deg is None else own_deg)
        pinhole = self._config.projection == "pinhole"
        focal_px = width / 2 / math.tan(fov_rad / 2) if pinhole else 0.0
        return Lens(width / fov_rad, focal_px, width / 2, height / 2)


def _plain(values: F64) -> F64:
    """Return an array of the one kind that the code is compiled for."""
    return np.array(values, np.float64, order="C")


@compiled
def _step(
    people: _Population, sights: _Sights, turn: Turn, lens: Lens, settings: _Settings
) -> tuple[int, int, I64, F64, F64, I64]:
    """Correct ego motion, predict, assign, correct; begin and end tracks.

    Returns:
        Number of tracks, next identity, and the columns of `BoxTracks`.
    """
    tracks, boxes = people.tracks, sights.boxes
    for i in range(people.known):
        track = tracks[i]
        if turn.rad != 0 or turn.up_rad != 0 or turn.sigma_rad != 0:
            turn_track(track, turn, lens)
        predict(track, sights.steps)
        track.detection = NONE
        waited_ns = sights.stamp_ns - track.seen_ns
        track.missed = track.missed + 1 if waited_ns <= settings.lost_max_ns else ENDED
    free = _usable(sights)
    high = free & (sights.scores >= settings.score_high)
    _match(tracks[: people.known], boxes, high, settings.iou_min, ENDED - 1)
    if settings.score_high > 0:
        low = free & (sights.scores < settings.score_high)
        _match(tracks[: people.known], boxes, low, settings.iou_min, 1)
    kept = 0
    for i in range(people.known):
        if tracks[i].detection != NONE:
            free[tracks[i].detection] = False
            correct(tracks[i], boxes[tracks[i].detection])
        _count(tracks[i], sights, settings)
        if _survives(tracks[i], settings):
            tracks[kept] = tracks[i]
            kept += 1
    next_id = people.next_id
    for j in range(len(boxes)):
        if free[j] and sights.scores[j] >= settings.score_new:
            _begin(tracks[kept], next_id, j, sights, settings)
            kept += 1
            next_id += 1
    ids, shown, scores, detections = _told(tracks[:kept], people.frames, settings)
    return kept, next_id, ids, shown, scores, detections


@compiled
def _usable(sights: _Sights) -> BOOL:
    """Tell which detections have a score and a box with an area."""
    usable = np.empty(len(sights.boxes), np.bool_)
    for j in range(len(sights.boxes)):
        left, top, right, bottom = sights.boxes[j]
        area = (right - left) * (bottom - top)  # finite only if all four are
        usable[j] = left < right and top < bottom and area < np.inf and sights.scores[j] >= 0
    return usable


@compiled
def _match(tracks: Records, boxes: F64, free: BOOL, iou_min: float, missed_max: int) -> None:
    """Give each track the detection that makes the sum of overlaps largest.

    Args:
        tracks: Those without a detection so far choose.
        boxes: Mx4, xyxy.
        free: M, which detections may be chosen.
        iou_min: Pairs that overlap less are refused.
        missed_max: Tracks unmatched for more frames, this one included, do not choose.
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
def _count(track: Any, sights: _Sights, settings: _Settings) -> None:
    """Keep the books of a track after the matching."""
    if track.detection == NONE:
        track.streak = 0
        return
    track.score = sights.scores[track.detection]
    track.seen_ns = sights.stamp_ns
    track.hits += 1
    track.streak += 1
    track.missed = 0
    track.confirmed |= track.streak >= settings.min_hits


@compiled
def _survives(track: Any, settings: _Settings) -> bool:
    """Tell whether a track goes on: T_age = min(T_lost + T_hits / R, max_age)."""
    t_age = min(settings.t_lost + track.hits / settings.r, settings.max_age)
    finite = np.isfinite(track.box[0] + track.box[1] + track.box[2] + track.box[3])
    return bool(track.missed <= t_age and finite)


@compiled
def _begin(track: Any, identity: int, j: int, sights: _Sights, settings: _Settings) -> None:
    """Begin a track with detection j."""
    begin(track, sights.boxes[j])
    track.id = identity
    track.detection = j
    track.score = sights.scores[j]
    track.seen_ns = sights.stamp_ns
    track.hits = 1
    track.streak = track.missed = 0
    track.confirmed = settings.min_hits == 0


@compiled
def _told(tracks: Records, frames: int, settings: _Settings) -> tuple[I64, F64, F64, I64]:
    """Return the columns of `BoxTracks`: who is confirmed and matched."""
    n = 0
    ids, detections = np.empty(len(tracks), np.int64), np.empty(len(tracks), np.int64)
    boxes, scores = np.empty((len(tracks), 4)), np.empty(len(tracks))
    for i in range(len(tracks)):
        track = tracks[i]
        sure = track.streak >= settings.min_hits if settings.streak else track.confirmed
        if track.detection != NONE and (sure or frames <= settings.min_hits):
            ids[n], detections[n], scores[n] = track.id, track.detection, track.score
            for k in range(4):
                boxes[n, k] = track.box[k]
            n += 1
    return ids[:n], boxes[:n], scores[:n], detections[:n]
