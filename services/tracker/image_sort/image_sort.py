"""SORT in the image: box Kalman filter, intersection over union, Hungarian method.

Odometry correction and dynamic survival are settings of it (docs/method.md, section 7 [Park 2021]).
One frame is one call of compiled code, see `sort_step`.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from people4d.messages import F64
from services.tracker.config import ImageSortConfig
from services.tracker.image_sort.box_assignment import I64
from services.tracker.image_sort.box_kalman import TRACK
from services.tracker.image_sort.camera_turn import STILL, Lens, Turn
from services.tracker.image_sort.sort_step import (
    BoxDetections,
    Records,
    SortSettings,
    TrackTable,
    step,
)

STATE_MAX = 1e24  # of a checkpoint; its largest numbers are variances of areas, in pixels^4
FOV_DEG = 69.0  # [deg] of a camera without calibration: colour of a RealSense D435i


@dataclass(frozen=True, slots=True)
class BoxFrame:
    """Detections of one image."""

    stamp_ns: int  # [ns] acquisition time, never before that of the last frame
    boxes_xyxy_px: F64  # [px] Nx4; those that are not finite or have no area are ignored
    scores: F64  # N, 0 to 1; those that are not finite are ignored
    size_px: tuple[int, int] = (640, 480)  # [px] width and height of the image
    turn: Turn = STILL  # of the camera since the last frame
    fov_deg: float = FOV_DEG  # [deg] horizontal field of view, unless the configuration has one


@dataclass(frozen=True, slots=True)
class BoxTracks:
    """Confirmed tracks matched in one frame, N rows each, ordered by id."""

    ids: I64  # N, from 1, never used again
    boxes_xyxy_px: F64  # [px] Nx4, filtered
    scores: F64  # N, of the detections
    detections: I64  # N, rows of the detections matched in this frame


class ImageSortCheckpoint(NamedTuple):
    """The state of `ImageSort`."""

    stamp_ns: int | None  # [ns] of the last frame
    frames: int  # since the beginning
    tracks: bytes  # of `box_kalman.TRACK`


class ImageSort:
    """Tracks of boxes from image to image."""

    def __init__(self, config: ImageSortConfig) -> None:
        self._config = config
        dynamic = config.lifetime == "dynamic"
        self._settings = SortSettings(
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
        self._table = TrackTable(np.zeros(16, TRACK), size=0, next_id=1, frames=0)
        self._stamp_ns: int | None = None

    def update(self, frame: BoxFrame) -> BoxTracks:
        """Process one frame, an empty one too, and return the confirmed tracks matched in it.

        Raises:
            ValueError: The stamp lies before that of the last frame, or there is not one score for
                each box of four numbers.
        """
        steps = self._steps_to(frame.stamp_ns)
        boxes, scores = _contiguous(frame.boxes_xyxy_px), _contiguous(frame.scores)
        if boxes.shape != (*scores.shape, 4):
            raise ValueError(f"boxes, scores: expected Nx4, N, got {boxes.shape}, {scores.shape}")
        tracks, count, next_id, frames = self._table
        room = count + len(boxes)
        if room > len(tracks):
            tracks = np.concatenate([tracks, np.zeros(2 * room - len(tracks), TRACK)])
        turn = frame.turn if self._config.ego_motion == "odometry" else STILL
        count, next_id, ids, track_boxes, track_scores, detections = step(
            TrackTable(tracks, count, next_id, frames + 1),
            BoxDetections(frame.stamp_ns, boxes, scores, steps),
            turn,
            self._lens(frame),
            self._settings,
        )
        self._table = TrackTable(tracks, count, next_id, frames + 1)
        self._stamp_ns = frame.stamp_ns
        return BoxTracks(ids, track_boxes, track_scores, detections)

    @property
    def tracks(self) -> Records:
        """All tracks as `box_kalman.TRACK`."""
        return self._table.tracks[: self._table.size].copy()

    @property
    def next_id(self) -> int:
        """The next identity to be given."""
        return self._table.next_id

    def raise_to(self, next_id: int) -> None:
        """Mark all identities below a number as used."""
        self._table = self._table._replace(next_id=max(self.next_id, next_id))

    def save(self) -> ImageSortCheckpoint:
        """Return a checkpoint of the state."""
        return ImageSortCheckpoint(self._stamp_ns, self._table.frames, self.tracks.tobytes())

    def restore(self, checkpoint: ImageSortCheckpoint) -> None:
        """Continue from a checkpoint.

        Raises:
            ValueError: It is damaged.
        """
        if len(checkpoint.tracks) % TRACK.itemsize:
            raise ValueError(
                f"expected tracks of {TRACK.itemsize} bytes, got {len(checkpoint.tracks)}"
            )
        tracks = np.frombuffer(checkpoint.tracks, TRACK).copy()
        numbers = [tracks[name] for name in ("x", "v", "pp", "pv", "vv", "box", "score")]
        if not all((np.abs(column) <= STATE_MAX).all() for column in numbers):
            raise ValueError(f"expected numbers of at most {STATE_MAX:g}")
        if (tracks["id"] < 1).any():
            raise ValueError("expected identities >= 1")
        self._table = TrackTable(tracks, len(tracks), self.next_id, checkpoint.frames)
        self.raise_to(int(tracks["id"].max(initial=0)) + 1)
        self._stamp_ns = checkpoint.stamp_ns

    def postpone(self, duration_ns: int) -> None:
        """Skip a time without frames."""
        if self._stamp_ns is not None:
            self._stamp_ns += duration_ns
        self._table.tracks["matched_ns"] += duration_ns

    def reset(self) -> None:
        """Delete all tracks and times; identities go on counting."""
        self._table = self._table._replace(size=0, frames=0)
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
        configured_deg = self._config.fov_deg
        fov_rad = math.radians(frame.fov_deg if configured_deg is None else configured_deg)
        pinhole = self._config.projection == "pinhole"
        focal_px = width / 2 / math.tan(fov_rad / 2) if pinhole else 0.0
        return Lens(width / fov_rad, focal_px, width / 2, height / 2)


def _contiguous(values: F64) -> F64:
    """Return an array of the one type that the code is compiled for."""
    return np.array(values, np.float64, order="C")
