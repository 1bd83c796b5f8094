"""Where people walked, in bounded memory."""

from typing import TypeVar

import numpy as np

from common.drawing.topdown import Trajectories
from people4d.messages import F64, StaticTransform, Tracks, Truth
from services.report.spread import EvenSample

K = TypeVar("K")

POINTS = 400  # of a trail
MOST_TRAILS = 60  # on the map; the shortest gives way


class Trails:
    """Gathers positions of tracks, truth and cameras in the frame that tracks are in."""

    def __init__(self) -> None:
        self.frame_id = "map"
        self._tracks: dict[int, EvenSample[F64]] = {}
        self._truth: dict[str, EvenSample[F64]] = {}
        self._cameras: dict[str, StaticTransform] = {}

    def add(self, message: Tracks | Truth | StaticTransform) -> None:
        """Take a message."""
        if isinstance(message, Tracks):
            self.frame_id = message.frame_id
            for track in message.tracks:
                if track.state == "confirmed":
                    _extend(self._tracks, track.id, track.position_m)
        elif isinstance(message, Truth):
            for person in message.people:
                _extend(self._truth, person.id, person.position_m)
        elif len(self._cameras) < MOST_TRAILS or message.child in self._cameras:
            self._cameras[message.child] = message

    def map_from_optical(self, frame_id: str) -> F64 | None:
        """Return the pose of a camera in the frame that tracks are in, None if unknown."""
        transform = self._cameras.get(frame_id)
        known = transform is not None and transform.parent == self.frame_id
        return transform.matrix if transform is not None and known else None

    def walks(self) -> Trajectories:
        """Return what the map shows."""
        return Trajectories(
            tracks={key: np.array(trail.values) for key, trail in self._tracks.items()},
            truth={key: np.array(trail.values) for key, trail in self._truth.items()},
            cameras=[c.matrix for c in self._cameras.values() if c.parent == self.frame_id],
            frame_id=self.frame_id,
        )


def _extend(trails: dict[K, EvenSample[F64]], key: K, position_m: F64) -> None:
    if key not in trails and len(trails) >= MOST_TRAILS:
        shortest = min(trails, key=lambda k: trails[k].count)
        del trails[shortest]
    trails.setdefault(key, EvenSample(POINTS)).add(position_m[:2])
