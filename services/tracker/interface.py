"""What every tracker takes and gives."""

import enum
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

from people4d.messages import F32, F64, ImageTrack, Track


class Need(enum.Enum):
    """A stream that a tracker uses beside the detections."""

    EMBEDDINGS = "embeddings"
    ODOMETRY = "odometry"


@dataclass(frozen=True, slots=True)
class Measurement:
    """One detected person as trackers see them: only detections with a 3D position come here."""

    index: int  # index into Detections.people of the frame
    box_xyxy_px: F32 | F64  # [px] 4, width and height > 0
    score: float  # detection confidence, 0 to 1
    position_m: F64  # [m] 3, frame: the one that tracks are in
    forward_m: float  # [m] distance from the camera along its optical axis
    # [m^2] 3x3 covariance of position_m, frame: the one that tracks are in; None: not told
    covariance_m2: F64 | None = None
    embedding: F64 | None = None  # D, unit length; None if unknown
    yaw_rad: float | None = None  # [rad] way faced, in the frame that tracks are in; None: unknown
    yaw_sigma_rad: float | None = None  # [rad] its standard deviation; None if unknown
    doubt_m2: F64 | None = None  # [m^2] 3x3, covariance on top of the usual; None: there is none


@dataclass(frozen=True, slots=True)
class Unplaced:
    """One detected person whose place is unknown; only trackers that follow boxes look at it."""

    index: int  # index into Detections.people of the frame
    box_xyxy_px: F32 | F64  # [px] 4, width and height > 0
    score: float  # detection confidence, 0 to 1


@dataclass(frozen=True, slots=True)
class Observation:
    """All that one frame told."""

    stamp_ns: int  # [ns] acquisition time, never before that of the last observation
    measurements: tuple[Measurement, ...] = ()  # in any order
    camera: str = "camera"  # name of the camera that saw the frame
    embedder: str = ""  # name of the model that made the embeddings; empty if there are none
    map_from_camera: F64 | None = None  # 4x4, where the camera stands; None if unknown
    size_px: tuple[int, int] | None = None  # [px] width and height of the image; None if unknown
    # Left and right edge of the image at focal length 1, x right; None if unknown
    edges: tuple[float, float] | None = None
    unplaced: tuple[Unplaced, ...] = ()  # people who are no measurements, in any order
    turn_sigma_rad: float = 0.0  # [rad] of the camera's direction, where it is a guess


class Tracker(Protocol):
    """People over time, from one observation to the next.

    A tracker owns its identities: they start at 1 and are never used again, not even after `reset`,
    nor, if it is `Lasting`, after a restart of its process.
    """

    needs: ClassVar[frozenset[Need]]

    def update(self, observation: Observation) -> list[Track]:
        """Take one frame, an empty one too, and return all tracks, ordered by id.

        Args:
            observation: The frame; the time step is measured from its stamp.

        Raises:
            ValueError: The stamp lies before that of the last observation.
        """
        ...

    def predict(self, stamp_ns: int) -> list[Track]:
        """Return the tracks as they should be at a later time; nothing is remembered of it.

        Args:
            stamp_ns: Time in nanoseconds, not before that of the last observation.
        """
        ...

    def reset(self) -> None:
        """Forget all people and times, but not which identities were given."""
        ...


@runtime_checkable
class InImage(Protocol):
    """A tracker that tells where people are in the image, too."""

    def in_image(self) -> tuple[ImageTrack, ...]:
        """Return the people in the image of the last update, ordered by id."""
        ...


class Identities:
    """Numbers for people, each given once."""

    def __init__(self) -> None:
        self.next = 1

    def new(self) -> int:
        """Return an identity that nobody has had."""
        self.next += 1
        return self.next - 1

    def raise_to(self, next_: int) -> None:
        """Take all below a number as given."""
        self.next = max(self.next, next_)


@runtime_checkable
class Lasting(Protocol):
    """A tracker whose people and identities outlive its process."""

    identities: Identities

    def save(self) -> bytes:
        """Return all that is known of people."""
        ...

    def restore(self, saved: bytes) -> None:
        """Go on with what another process saved.

        Raises:
            DecodeError: It is of another method, or damaged; nothing has changed then.
        """
        ...

    def postpone(self, duration_ns: int) -> None:
        """Take a time as not passed, since nobody looked: stamps known are so much later."""
        ...


def in_order(measurements: tuple[Measurement, ...]) -> list[Measurement]:
    """Sort measurements by what the camera saw, so that the order of arrival decides nothing."""

    def key(m: Measurement) -> tuple[float, ...]:
        return (-m.score, *map(float, m.box_xyxy_px), m.forward_m)

    return sorted(measurements, key=key)
