"""SORT in the image: box Kalman filter, intersection over union, Hungarian method.

Settings add odometry correction and dynamic survival (docs/method.md, section 7 [Park 2021]).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from common.geometry.boxes import iou_xyxy
from people4d.messages import F64
from services.tracker.config import ImageSortConfig
from services.tracker.image_sort.box_kalman import TRACK, Records, begin, correct, predict
from services.tracker.image_sort.camera_turn import STILL, Lens, Turn, turn_tracks

I64 = npt.NDArray[np.int64]
BOOL = npt.NDArray[np.bool_]
NONE = -1  # index of the detection of an unmatched track
ENDED = 2**62  # number of missed frames of an expired track
FOV_DEG = 69.0  # field of view without a calibration: colour of a RealSense D435i [deg]
IOU_MIN = 0.3  # minimum intersection over union of a pair [Bewley 2016]
LOST_MAX_S = 5.0  # maximum time without a match of any track [s]


@dataclass(frozen=True, slots=True)
class BoxFrame:
    """Detections of one image."""

    stamp_ns: int  # [ns] acquisition time
    boxes_xyxy_px: F64  # [px] Nx4; boxes that are not finite or have no area are ignored
    scores: F64  # N, 0 to 1; scores that are not finite are ignored
    size_px: tuple[int, int] = (640, 480)  # [px] width and height of the image
    turn: Turn = STILL  # turn of the camera since the last frame
    fov_deg: float = FOV_DEG  # [deg] horizontal field of view


@dataclass(frozen=True, slots=True)
class BoxTracks:
    """Confirmed tracks matched in one frame, N rows each, ordered by id."""

    ids: I64  # N, from 1, never reused
    boxes_xyxy_px: F64  # [px] Nx4, filtered
    scores: F64  # N, scores of the detections
    detections: I64  # N, rows of the detections matched in this frame


class ImageSortCheckpoint(NamedTuple):
    """The state of `ImageSort`."""

    frames: int  # number of frames
    tracks: bytes  # records of `box_kalman.TRACK`


class ImageSort:
    """Tracks of boxes from image to image."""

    def __init__(self, config: ImageSortConfig) -> None:
        self._config = config
        self._tracks: Records = np.zeros(0, TRACK)
        self._next_id, self._frames = 1, 0
        self._stamp_ns = 0  # time of the current frame [ns]

    def update(self, frame: BoxFrame) -> BoxTracks:
        """Process one frame, which may be empty, and return the confirmed tracks matched in it."""
        boxes = np.asarray(frame.boxes_xyxy_px, np.float64)
        scores = np.asarray(frame.scores, np.float64)
        self._stamp_ns = frame.stamp_ns
        self._frames += 1
        with np.errstate(over="ignore", invalid="ignore"):  # non-finite tracks end below
            self._predict(frame)
            free = self._associate(boxes, scores)
            self._update(boxes, scores)
            self._begin(boxes, scores, free)
        return self._published()

    def _predict(self, frame: BoxFrame) -> None:
        """Correct ego motion, predict, and count a miss for every track."""
        tracks = self._tracks
        if self._config.ego_motion == "odometry":
            turn_tracks(tracks, frame.turn, self._lens(frame))
        predict(tracks)
        unmatched_ns = frame.stamp_ns - tracks["matched_ns"]
        lost = unmatched_ns > LOST_MAX_S * 1e9
        tracks["missed"] = np.where(lost, ENDED, tracks["missed"] + 1)

    def _associate(self, boxes: F64, scores: F64) -> BOOL:
        """Match detections to tracks; return the unmatched usable detections."""
        size = boxes[:, 2:] - boxes[:, :2]
        free: BOOL = (size > 0).all(axis=1) & (size.prod(axis=1) < np.inf) & (scores >= 0)
        self._tracks["detection"] = NONE
        self._match(boxes, free)
        free[self._tracks["detection"][self._tracks["detection"] != NONE]] = False
        return free

    def _match(self, boxes: F64, free: BOOL) -> None:
        """Assign free detections (M) to tracks at the largest sum of overlaps.

        Pairs that overlap less than IOU_MIN and expired tracks are left out.
        """
        rows = np.flatnonzero(self._tracks["missed"] < ENDED)
        columns = np.flatnonzero(free)
        if not len(rows) or not len(columns):
            return
        overlaps = iou_xyxy(self._tracks["box"][rows], boxes[columns])
        gain = np.where(overlaps >= IOU_MIN, overlaps, 0.0)
        i, j = linear_sum_assignment(gain, maximize=True)
        admissible = gain[i, j] > 0
        self._tracks["detection"][rows[i[admissible]]] = columns[j[admissible]]

    def _update(self, boxes: F64, scores: F64) -> None:
        """Update matched tracks, and delete expired ones.

        T_age = min(T_lost + T_hits / R, max_age); R and max_age apply to a dynamic lifetime.
        """
        config, tracks = self._config, self._tracks
        matched = tracks["detection"] != NONE
        tracks["streak"][~matched] = 0
        found = tracks[matched]  # a copy
        correct(found, boxes[found["detection"]])
        found["score"] = scores[found["detection"]]
        found["matched_ns"], found["missed"] = self._stamp_ns, 0
        found["hits"] += 1
        found["streak"] += 1
        found["confirmed"] |= found["streak"] >= config.min_hits
        tracks[matched] = found
        t_age = np.full(len(tracks), config.t_lost)
        if config.lifetime == "dynamic":
            t_age = np.minimum(config.t_lost + tracks["hits"] / config.r, config.max_age)
        finite = np.isfinite(tracks["box"]).all(axis=1)
        self._tracks = tracks[(tracks["missed"] <= t_age) & finite]

    def _begin(self, boxes: F64, scores: F64, free: BOOL) -> None:
        """Begin a track from each unmatched detection."""
        columns = np.flatnonzero(free)
        new = np.zeros(len(columns), TRACK)
        begin(new, boxes[columns])
        new["id"] = self._next_id + np.arange(len(new))
        new["detection"], new["score"] = columns, scores[columns]
        new["matched_ns"], new["hits"] = self._stamp_ns, 1
        new["confirmed"] = self._config.min_hits == 0
        self._next_id += len(new)
        self._tracks = np.concatenate([self._tracks, new])

    def _published(self) -> BoxTracks:
        """Return confirmed and matched tracks."""
        tracks, config = self._tracks, self._config
        confirmed = tracks["streak"] >= config.min_hits
        first_frames = self._frames <= config.min_hits
        chosen = tracks[(tracks["detection"] != NONE) & (confirmed | first_frames)]
        return BoxTracks(chosen["id"], chosen["box"], chosen["score"], chosen["detection"])

    @property
    def tracks(self) -> Records:
        """All tracks as `box_kalman.TRACK`."""
        return self._tracks.copy()

    @property
    def next_id(self) -> int:
        """The next unused identity."""
        return self._next_id

    def raise_to(self, next_id: int) -> None:
        """Mark all identities below a number as used."""
        self._next_id = max(self._next_id, next_id)

    def save(self) -> ImageSortCheckpoint:
        """Return a checkpoint of the state."""
        return ImageSortCheckpoint(self._frames, self._tracks.tobytes())

    def restore(self, checkpoint: ImageSortCheckpoint) -> None:
        """Continue from a checkpoint."""
        self._tracks = np.frombuffer(checkpoint.tracks, TRACK).copy()
        self._frames = checkpoint.frames

    def postpone(self, duration_ns: int) -> None:
        """Shift all times by a pause without frames."""
        self._tracks["matched_ns"] += duration_ns

    def reset(self) -> None:
        """Delete all tracks and times; identities are not reused."""
        self._tracks, self._frames = np.zeros(0, TRACK), 0

    def _lens(self, frame: BoxFrame) -> Lens:
        width, height = frame.size_px
        fov_rad = math.radians(frame.fov_deg)
        pinhole = self._config.projection == "pinhole"
        focal_px = width / 2 / math.tan(fov_rad / 2) if pinhole else 0.0
        return Lens(width / fov_rad, focal_px, width / 2, height / 2)
