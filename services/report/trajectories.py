"""Trajectories of tracks and truth, in bounded memory."""

from typing import TypeVar

import numpy as np

from common.drawing.topdown import Trajectories
from people4d.messages import F64, StaticTransform, Tracks, Truth
from services.report.even_sample import EvenSample

K = TypeVar("K")

MAX_POINTS = 400  # maximum number of points of a trajectory
MAX_TRAJECTORIES = 60  # maximum number on the map; the shortest is dropped


class TrajectoryStore:
    """Positions of tracks, truth and cameras in the frame of the tracks."""

    def __init__(self) -> None:
        self.frame_id = "map"
        self._tracks: dict[int, EvenSample[F64]] = {}
        self._truth: dict[str, EvenSample[F64]] = {}
        self._cameras: dict[str, StaticTransform] = {}

    def add_message(self, message: Tracks | Truth | StaticTransform) -> None:
        """Add the positions of a message."""
        if isinstance(message, Tracks):
            self.frame_id = message.frame_id
            for track in message.tracks:
                if track.state == "confirmed":
                    _extend(self._tracks, track.id, track.position_m)
        elif isinstance(message, Truth):
            for person in message.people:
                _extend(self._truth, person.id, person.position_m)
        elif len(self._cameras) < MAX_TRAJECTORIES or message.child in self._cameras:
            self._cameras[message.child] = message

    def map_from_optical(self, frame_id: str) -> F64 | None:
        """Return the pose of a camera in the frame of the tracks, None if unknown."""
        transform = self._cameras.get(frame_id)
        known = transform is not None and transform.parent == self.frame_id
        return transform.matrix if transform is not None and known else None

    def trajectories(self) -> Trajectories:
        """Return the trajectories for the map."""
        return Trajectories(
            tracks={key: np.array(sample.values) for key, sample in self._tracks.items()},
            truth={key: np.array(sample.values) for key, sample in self._truth.items()},
            cameras=[c.matrix for c in self._cameras.values() if c.parent == self.frame_id],
            frame_id=self.frame_id,
        )


def _extend(samples: dict[K, EvenSample[F64]], key: K, position_m: F64) -> None:
    if key not in samples and len(samples) >= MAX_TRAJECTORIES:
        shortest = min(samples, key=lambda k: samples[k].count)
        del samples[shortest]
    samples.setdefault(key, EvenSample(MAX_POINTS)).add_value(position_m[:2])
