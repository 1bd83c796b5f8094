"""SORT in the image as a tracker: boxes are associated, depth gives the positions."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import msgspec
import numpy as np

from common.io.packed import pack, unpack
from people4d.messages import ImageTrack, Track
from people4d.messages.base import MAX_PX
from services.tracker.config import TrackerConfig
from services.tracker.image_sort.box_kalman import Records
from services.tracker.image_sort.camera_turn import (
    CameraDirection,
    camera_direction,
    turn_between,
)
from services.tracker.image_sort.image_sort import (
    FOV_DEG,
    NONE,
    BoxFrame,
    BoxTracks,
    ImageSort,
    ImageSortCheckpoint,
)
from services.tracker.interface import (
    IdCounter,
    Measurement,
    Observation,
    UnlocatedDetection,
)
from services.tracker.motion.lifecycle import Lifecycle
from services.tracker.motion.motion import PositionMotion
from services.tracker.motion.track_set import TrackSet
from services.tracker.motion.yaw_sources import make_yaw
from services.tracker.stateful import TrackerCheckpoint, TrackSetTracker

NEVER = 2**62  # [frames] unlimited: tracks end in the image only


class ImageTrackerCheckpoint(msgspec.Struct, frozen=True, kw_only=True):
    """The state of the tracker."""

    next_id: int
    # Tracks and direction by camera
    images: dict[str, tuple[ImageSortCheckpoint, CameraDirection | None]]
    positions: TrackerCheckpoint


@dataclass(slots=True)
class CameraTracks:
    """The tracks in the image of one camera."""

    sort: ImageSort
    direction: CameraDirection | None = None  # direction in the last frame


class ImageTracker(TrackSetTracker):
    """SORT in the image of each camera.

    Boxes alone associate and end tracks. Positions known from depth are filtered as in
    StrongSORT-3D; tracks without depth are published in the image only.
    """

    def __init__(self, config: TrackerConfig) -> None:
        self._config = config.image_sort
        lifecycle = Lifecycle(
            confirm_hits=1,
            tentative_frames=NEVER,
            lost_frames=NEVER,
            lost_s=config.max_lost_s,
        )
        motion = PositionMotion(config.strongsort3d)
        yaw = make_yaw(config.yaw, config.yaw_speed_min_mps)
        super().__init__(TrackSet(motion, lifecycle, yaw))
        self.ids = IdCounter()
        self._images: dict[str, CameraTracks] = {}
        self._image_tracks: tuple[ImageTrack, ...] = ()

    def update(self, observation: Observation) -> list[Track]:
        """Track the boxes, then update the positions of the tracks.

        Box states cannot go back in time: a late frame is processed at the time of the last one.
        """
        if self.tracks.stamp_ns is not None and observation.stamp_ns < self.tracks.stamp_ns:
            observation = replace(observation, stamp_ns=self.tracks.stamp_ns)
        skipped_ns = self.tracks.bridge_absence(observation.stamp_ns)
        for one in self._images.values():
            one.sort.postpone(skipped_ns)
        image = self._images.setdefault(observation.camera, CameraTracks(ImageSort(self._config)))
        image.sort.raise_to(self.ids.next)
        matched = image.sort.update(_frame(observation, image))
        self.ids.raise_to(image.sort.next_id)
        self._image_tracks = _image_tracks(
            image.sort.tracks, set(matched.ids.tolist()), observation.stamp_ns
        )
        return self._update_positions(observation, matched)

    def image_tracks(self) -> tuple[ImageTrack, ...]:
        """Return the tracks in the image of the last update, ordered by id."""
        return self._image_tracks

    def reset(self) -> None:
        """Delete all tracks and times; identities are not reused."""
        super().reset()
        self._images.clear()
        self._image_tracks = ()

    def save(self) -> bytes:
        """Return a checkpoint of the state."""
        images = {name: (one.sort.save(), one.direction) for name, one in self._images.items()}
        state = ImageTrackerCheckpoint(
            next_id=self.ids.next, images=images, positions=self.checkpoint()
        )
        return pack(state)

    def restore(self, saved: bytes) -> None:
        """Continue from a checkpoint."""
        state = unpack(saved, ImageTrackerCheckpoint)
        for name, (checkpoint, direction) in state.images.items():
            self._images[name] = CameraTracks(ImageSort(self._config), direction)
            self._images[name].sort.restore(checkpoint)
        self.restore_checkpoint(state.positions)
        self.ids.raise_to(state.next_id)

    def _update_positions(self, observation: Observation, matched: BoxTracks) -> list[Track]:
        """Update the positions of tracks in any image."""
        tracks = self.tracks
        tracks.predict(observation)
        by_index = {m.index: m for m in observation.measurements}
        measured = {
            identity: by_index[index]
            for identity, index in zip(
                matched.ids.tolist(), matched.detections.tolist(), strict=True
            )
            if index in by_index
        }
        ids = {i for image in self._images.values() for i in image.sort.tracks["id"].tolist()}
        tracks.end({record.id for record in tracks.records} - ids)
        known = [(t, measured.pop(t.id)) for t in tracks.records if t.id in measured]
        tracks.update(known, observation)
        for identity, measurement in measured.items():
            tracks.begin(measurement, observation, identity)
        tracks.records.sort(key=lambda record: record.id)
        return tracks.manage([], observation)


def _frame(observation: Observation, image: CameraTracks) -> BoxFrame:
    """Return a frame with one row for each detection of the message, NaN for unusable ones."""
    found: list[Measurement | UnlocatedDetection] = [
        *observation.measurements,
        *observation.unlocated,
    ]
    rows = max((one.index for one in found), default=-1) + 1
    boxes, scores = np.full((rows, 4), np.nan), np.zeros(rows)
    for one in found:
        boxes[one.index], scores[one.index] = one.box_xyxy_px, one.score
    fov_deg = FOV_DEG
    if observation.edges:
        edges = observation.edges
        fov_deg = math.degrees(math.atan(edges.right) - math.atan(edges.left))
    before = image.direction
    image.direction = camera_direction(observation.map_from_camera, observation.turn_sigma_rad)
    return BoxFrame(
        stamp_ns=observation.stamp_ns,
        boxes_xyxy_px=boxes,
        scores=scores,
        size_px=observation.size_px or (640, 480),
        turn=turn_between(before, image.direction),
        fov_deg=fov_deg,
    )


def _image_tracks(tracks: Records, confirmed: set[int], stamp_ns: int) -> tuple[ImageTrack, ...]:
    result = []
    # Boxes of fast lost tracks may leave the range of messages.
    for track in tracks[(np.abs(tracks["box"]) <= MAX_PX).all(axis=1)]:
        state: Literal["tentative", "confirmed", "lost"] = "tentative"
        if track["id"] in confirmed:
            state = "confirmed"
        elif track["confirmed"] and track["detection"] == NONE:
            state = "lost"
        result.append(
            ImageTrack(
                id=int(track["id"]),
                state=state,
                box_xyxy_px=track["box"].copy(),
                hits=int(track["hits"]),
                time_since_update_s=int(stamp_ns - track["matched_ns"]) / 1e9,
                detection=None if track["detection"] == NONE else int(track["detection"]),
                score=float(track["score"]),
            )
        )
    return tuple(result)
