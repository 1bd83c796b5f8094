"""SORT in the image as a tracker: boxes tell who is who, depth tells where they are."""

import math
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import msgspec
import numpy as np

from common.geometry.transforms import wrap
from people4d.errors import DecodeError
from people4d.messages import F64, ImageTrack, Track
from services.tracker import state
from services.tracker.config import TrackerConfig
from services.tracker.image_sort.camera_turn import STILL, Turn
from services.tracker.image_sort.config import ImageSortConfig
from services.tracker.image_sort.image_sort import (
    FOV_DEG,
    NONE,
    BoxFrame,
    BoxTracks,
    ImageMemory,
    ImageSort,
    Records,
)
from services.tracker.interface import Identities, Measurement, Need, Observation, Unplaced
from services.tracker.motion.motion import PointMotion
from services.tracker.motion.population import Population, Survival, Target
from services.tracker.motion.yaw import make_yaw

METHOD = "image_sort"
NEVER = 2**62  # frames: who is gone is decided in the image
LEVEL_MIN = 0.2  # a camera that looks more steeply (by 78 deg) up or down turns nothing sideways

Way: TypeAlias = tuple[float, float, float]  # [rad] of the optical axis: to the left, up, variance


class Kept(msgspec.Struct, frozen=True, kw_only=True):
    """What outlives a process."""

    method: str
    next_id: int
    images: dict[str, tuple[ImageMemory, Way | None]]  # by camera
    people: bytes  # where they are


@dataclass(slots=True)
class Image:
    """The people in the image of one camera."""

    sort: ImageSort
    way: Way | None = None  # where the camera looked last


class ImageTracker:
    """SORT in the image of each camera.

    People are matched, kept and given up by their boxes alone. Where depth tells their place, it
    is filtered as in StrongSORT-3D; the others are told in the image only.
    """

    needs: ClassVar[frozenset[Need]] = frozenset()

    def __init__(self, config: TrackerConfig) -> None:
        self._config = config.image_sort
        self._motion = PointMotion(config.strongsort3d)
        self._yaw = make_yaw(config)
        survival = Survival(
            confirm_hits=1,
            tentative_frames=NEVER,
            lost_frames=NEVER,
            lost_s=config.max_lost_s,
        )
        self._people = Population(self._motion, survival, self._yaw)
        self._images: dict[str, Image] = {}
        self._shown: tuple[ImageTrack, ...] = ()
        self.identities = Identities()
        _compile(self._config)

    def update(self, observation: Observation) -> list[Track]:
        """Follow boxes, then bring the places of those followed up to date."""
        image = self._images.setdefault(observation.camera, Image(ImageSort(self._config)))
        image.sort.raise_to(self.identities.next)
        told = image.sort.update(_frame(observation, image))
        self.identities.raise_to(image.sort.next_id)
        self._shown = _shown(image.sort.tracks, told, observation.stamp_ns)
        return self._place(observation, told)

    def in_image(self) -> tuple[ImageTrack, ...]:
        """Return the people in the image of the last update, ordered by id."""
        return self._shown

    def predict(self, stamp_ns: int) -> list[Track]:
        """Return the tracks as they should be at a later time."""
        return self._people.predicted(stamp_ns)

    def reset(self) -> None:
        """Forget all people and times, but not which identities were given."""
        self._people.clear()
        self._images.clear()
        self._shown = ()

    def save(self) -> bytes:
        """Return all that is known of people."""
        kept = Kept(
            method=METHOD,
            next_id=self.identities.next,
            images={name: (image.sort.save(), image.way) for name, image in self._images.items()},
            people=state.save(METHOD, self._people),
        )
        return state.pack(kept)

    def restore(self, saved: bytes) -> None:
        """Go on with what another process saved."""
        kept = state.unpack(saved, Kept)
        if kept.method != METHOD:
            raise DecodeError(f"what the tracker kept: expected {METHOD}, got {kept.method}")
        images = {
            name: Image(ImageSort(self._config), way) for name, (_, way) in kept.images.items()
        }
        try:
            for name, (memory, _) in kept.images.items():
                images[name].sort.restore(memory)
        except ValueError as error:
            raise DecodeError(f"what the tracker kept: {error}") from error
        state.restore(METHOD, self._people, kept.people)
        self._images = images
        next_ids = [kept.next_id, *(image.sort.next_id for image in images.values())]
        self.identities.raise_to(max(next_ids))

    def postpone(self, duration_ns: int) -> None:
        """Take a time as not passed, since nobody looked."""
        self._people.postpone(duration_ns)
        for image in self._images.values():
            image.sort.postpone(duration_ns)

    def _place(self, observation: Observation, told: BoxTracks) -> list[Track]:
        """Correct the places of people who are followed in any image."""
        people = self._people
        people.advance(observation)
        by_index = {m.index: m for m in observation.measurements}
        seen = {
            identity: by_index[index]
            for identity, index in zip(told.ids.tolist(), told.detections.tolist(), strict=True)
            if index in by_index
        }
        followed = {i for image in self._images.values() for i in image.sort.tracks["id"].tolist()}
        people.targets = [target for target in people.targets if target.id in followed]
        known = [(t, seen.pop(t.id)) for t in people.targets if t.id in seen]
        people.match(known, observation)
        people.targets += [self._begin(*one, observation) for one in seen.items()]
        people.targets.sort(key=lambda target: target.id)
        return people.finish([], observation)

    def _begin(self, identity: int, seen: Measurement, observation: Observation) -> Target:
        x, P = self._motion.start(seen)
        (yaw,) = self._yaw.update([None], [seen], np.zeros((1, 3)))
        return Target(
            id=identity,
            x=x,
            P=P,
            score=seen.score,
            camera=observation.camera,
            seen_ns=observation.stamp_ns,
            detection=seen.index,
            confirmed=True,
            yaw=yaw,
        )


def _compile(config: ImageSortConfig) -> None:
    """Have all code compiled: the first frame must not wait for that."""
    box = np.array([[0.0, 0.0, 1.0, 2.0]])
    sort = ImageSort(config)
    for stamp_ns in (0, 1):
        sort.update(BoxFrame(stamp_ns, box, np.ones(1), turn=Turn(1e-3, 1e-3, 1e-3)))


def _frame(observation: Observation, image: Image) -> BoxFrame:
    """Return a frame whose rows are the detections of the message, unusable ones as no box."""
    people: list[Measurement | Unplaced] = [*observation.measurements, *observation.unplaced]
    rows = max((person.index for person in people), default=-1) + 1
    boxes, scores = np.full((rows, 4), np.nan), np.zeros(rows)
    for person in people:
        boxes[person.index], scores[person.index] = person.box_xyxy_px, person.score
    fov_deg = FOV_DEG
    if observation.edges:
        left, right = observation.edges
        fov_deg = math.degrees(math.atan(right) - math.atan(left))
    return BoxFrame(
        stamp_ns=observation.stamp_ns,
        boxes_xyxy_px=boxes,
        scores=scores,
        size_px=observation.size_px or (640, 480),
        turn=_turn(observation, image),
        fov_deg=fov_deg,
    )


def _turn(observation: Observation, image: Image) -> Turn:
    """Return how far the camera turned since its last frame, and remember where it looks.

    What was guessed wrong for the last frame is made good by this one's turn.
    """
    before = image.way
    image.way = now = way_of(observation.map_from_camera, observation.turn_sigma_rad)
    if before is None or now is None:
        return STILL
    variance = max(now[2] - before[2], 0.0)
    return Turn(wrap(now[0] - before[0]), math.sqrt(variance), now[1] - before[1])


def way_of(map_from_camera: F64 | None, sigma_rad: float = 0.0) -> Way | None:
    """Return where a camera looks; None if that is unknown, or too steep.

    Args:
        map_from_camera: 4x4, from its optical frame to a frame whose z is up.
        sigma_rad: Standard deviation of its direction, in radians.
    """
    if map_from_camera is None:
        return None
    x, y, z = map_from_camera[:3, 2].tolist()
    level = math.hypot(x, y)
    return (math.atan2(y, x), math.atan2(z, level), sigma_rad**2) if level >= LEVEL_MIN else None


def _shown(tracks: Records, told: BoxTracks, stamp_ns: int) -> tuple[ImageTrack, ...]:
    confirmed = set(told.ids.tolist())
    people = []
    for track in tracks:
        found: Literal["tentative", "confirmed", "lost"] = "tentative"
        if track["id"] in confirmed:
            found = "confirmed"
        elif track["confirmed"] and track["detection"] == NONE:
            found = "lost"
        people.append(
            ImageTrack(
                id=int(track["id"]),
                state=found,
                box_xyxy_px=track["box"].copy(),
                hits=int(track["hits"]),
                time_since_update_s=int(stamp_ns - track["seen_ns"]) / 1e9,
                detection=None if track["detection"] == NONE else int(track["detection"]),
                score=float(track["score"]),
            )
        )
    return tuple(people)
