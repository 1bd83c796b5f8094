"""Input and interface of every tracker."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, NamedTuple

from common.geometry.planar_covariance import PlanarCovariance
from common.geometry.transforms import invert
from people4d.messages import F32, F64, ImageTrack, Track
from people4d.messages.areas import AREAS_MAX

LATE_MAX_NS = 1_000_000_000  # maximum age of a late frame, behind the last one [ns]


@dataclass(frozen=True, slots=True)
class Measurement:
    """One detection with a 3D position."""

    index: int  # index into Detections.detections of the frame
    box_xyxy_px: F32 | F64  # [px] 4, width and height > 0
    score: float  # detection confidence, 0 to 1
    position_m: F64  # [m] 3, frame: the tracking frame
    forward_m: float  # [m] distance from the camera along its optical axis
    covariance_m2: F64 | None = None  # [m^2] 3x3 of position_m, frame: tracking; None: unknown
    embedding: F64 | None = None  # D, unit length; None if unknown
    yaw_rad: float | None = None  # [rad] orientation, frame: tracking; None: unknown
    # [rad] standard deviation of the orientation; None if unknown
    yaw_sigma_rad: float | None = None
    bearing_rad: float | None = None  # [rad] direction from the camera; None: unknown
    added_covariance_m2: F64 | None = None  # [m^2] 3x3, addition to the measurement noise
    person_log_odds: float = 0.0  # log-odds of a person by its image; 0: unknown


@dataclass(frozen=True, slots=True)
class UnlocatedDetection:
    """One detection without a 3D position; only trackers of boxes use it."""

    index: int  # index into Detections.detections of the frame
    box_xyxy_px: F32 | F64  # [px] 4, width and height > 0
    score: float  # detection confidence, 0 to 1


class ImageEdges(NamedTuple):
    """Edges of a camera's image at focal length 1, x right and y down."""

    left: float
    right: float
    top: float
    bottom: float


@dataclass(frozen=True)
class Observation:
    """All measurements of one frame."""

    stamp_ns: int  # [ns] acquisition time, at most LATE_MAX_NS before the last observation
    measurements: tuple[Measurement, ...] = ()  # in any order
    camera: str = "camera"  # name of the camera of the frame
    embedder: str = ""  # name of the model of the last embeddings; empty if there were none
    map_from_camera: F64 | None = None  # 4x4, pose of the optical frame; None if unknown
    size_px: tuple[int, int] | None = None  # [px] width and height of the image; None if unknown
    edges: ImageEdges | None = None  # edges of the image; None if unknown
    unlocated: tuple[UnlocatedDetection, ...] = ()  # in any order
    turn_sigma_rad: float = 0.0  # [rad] standard deviation of an extrapolated camera direction
    base: PlanarCovariance | None = None  # covariance of the base of the camera; None: unknown

    @cached_property
    def camera_from_map(self) -> F64 | None:
        """Inverse of map_from_camera."""
        return None if self.map_from_camera is None else invert(self.map_from_camera)


@dataclass(slots=True)
class GalleryEntry:
    """One person of the gallery."""

    position_m: F64  # [m] 3, position at the last match
    matched_ns: int  # [ns] stamp of the last match
    views: list[F64] = field(default_factory=list)  # embeddings of unit length
    matches: int = 0  # number of matched frames


class IdCounter:
    """Counter of identities, each assigned once.

    Area n of a site assigns n, n + 1000, n + 2000, ...; a tracker without areas 1, 2, 3, ...
    """

    def __init__(self) -> None:
        self.next = 1
        self._step = 1

    def divide(self, area: int) -> None:
        """Restrict identities to an area, by its number."""
        self._step = AREAS_MAX
        self.next = self._from(self.next, area)

    def new(self) -> int:
        """Return an unused identity."""
        self.next += self._step
        return self.next - self._step

    def raise_to(self, next_: int) -> None:
        """Mark all identities below a number as used."""
        self.next = self._from(max(self.next, next_), self.next)

    def is_own(self, identity: int) -> bool:
        """Return True if an identity belongs to this area."""
        return (identity - self.next) % self._step == 0

    def _from(self, least: int, area: int) -> int:
        """Return the lowest identity of an area that is not below a number."""
        return least + (area - least) % self._step


class Tracker(ABC):
    """Tracks over time, from one observation to the next.

    A tracker owns its identities: they start at 1 and are never reused, not even after `reset` or,
    if it saves its state, after a restart of its process.
    """

    uses_embeddings: ClassVar[bool] = False
    ids: IdCounter | None = None  # None: the state is not saved

    @abstractmethod
    def update(self, observation: Observation) -> list[Track]:
        """Process one frame, also an empty or late one; return the tracks at its time, by id."""

    @abstractmethod
    def predict(self, stamp_ns: int) -> list[Track]:
        """Return the tracks predicted to a later time; the state does not change."""

    @abstractmethod
    def reset(self) -> None:
        """Delete all tracks and times; identities are not reused."""

    def image_tracks(self) -> tuple[ImageTrack, ...] | None:
        """Return the tracks in the image of the last update by id; None if it is off."""
        return None

    def save(self) -> bytes:
        """Return a checkpoint of the state; empty if it is not saved."""
        return b""

    def restore(self, saved: bytes) -> None:  # noqa: B027
        """Continue from a checkpoint.

        Raises:
            DecodeError: The bytes are not a checkpoint of this tracker; nothing has changed.
        """


def in_order(measurements: tuple[Measurement, ...]) -> list[Measurement]:
    """Sort measurements by content, so that the result does not depend on their order."""

    def key(m: Measurement) -> tuple[float, ...]:
        return (-m.score, *m.box_xyxy_px.tolist(), m.forward_m)

    return sorted(measurements, key=key)
