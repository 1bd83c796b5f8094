"""Input and interface of every tracker."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from people4d.messages import F32, F64, ImageTrack, Track


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
    yaw_sigma_rad: float | None = None  # [rad] its standard deviation; None if unknown
    added_covariance_m2: F64 | None = None  # [m^2] 3x3, on top of the measurement noise


@dataclass(frozen=True, slots=True)
class UnlocatedDetection:
    """One detection without a 3D position; only trackers of boxes use it."""

    index: int  # index into Detections.detections of the frame
    box_xyxy_px: F32 | F64  # [px] 4, width and height > 0
    score: float  # detection confidence, 0 to 1


@dataclass(frozen=True, slots=True)
class Observation:
    """All measurements of one frame."""

    stamp_ns: int  # [ns] acquisition time, never before that of the last observation
    measurements: tuple[Measurement, ...] = ()  # in any order
    camera: str = "camera"  # name of the camera of the frame
    embedder: str = ""  # name of the model of the embeddings; empty if there are none
    map_from_camera: F64 | None = None  # 4x4, pose of the optical frame; None if unknown
    size_px: tuple[int, int] | None = None  # [px] width and height of the image; None if unknown
    # Left and right edge of the image at focal length 1, x right; None if unknown
    edges: tuple[float, float] | None = None
    unlocated: tuple[UnlocatedDetection, ...] = ()  # in any order
    turn_sigma_rad: float = 0.0  # [rad] of the camera's direction where it is extrapolated


class IdCounter:
    """Identities, each given once."""

    def __init__(self) -> None:
        self.next = 1

    def new(self) -> int:
        """Return an unused identity."""
        self.next += 1
        return self.next - 1

    def raise_to(self, next_: int) -> None:
        """Mark all identities below a number as used."""
        self.next = max(self.next, next_)


class Tracker(ABC):
    """Tracks over time, from one observation to the next.

    A tracker owns its identities: they start at 1 and are never used again, not even after `reset`,
    nor, if it saves its state, after a restart of its process.
    """

    uses_embeddings: ClassVar[bool] = False
    ids: IdCounter | None = None  # None: the state is not saved

    @abstractmethod
    def update(self, observation: Observation) -> list[Track]:
        """Process one frame, an empty one too, and return all tracks, ordered by id.

        Raises:
            ValueError: The stamp lies before that of the last observation.
        """

    @abstractmethod
    def predict(self, stamp_ns: int) -> list[Track]:
        """Return the tracks predicted to a later time; the state does not change."""

    @abstractmethod
    def reset(self) -> None:
        """Delete all tracks and times; identities go on counting."""

    def image_tracks(self) -> tuple[ImageTrack, ...] | None:
        """Return the tracks in the image of the last update by id; None: there are none ever."""
        return None

    def save(self) -> bytes:
        """Return a checkpoint of the state; empty if it is not saved."""
        return b""

    def restore(self, saved: bytes) -> None:  # noqa: B027
        """Continue from a checkpoint.

        Raises:
            DecodeError: It is of another method, or damaged; nothing has changed then.
        """

    def postpone(self, duration_ns: int) -> None:  # noqa: B027
        """Skip a time without frames: all stamps of the state become so much later."""


def in_order(measurements: tuple[Measurement, ...]) -> list[Measurement]:
    """Sort measurements by content, so that the result does not depend on their order."""

    def key(m: Measurement) -> tuple[float, ...]:
        return (-m.score, *map(float, m.box_xyxy_px), m.forward_m)

    return sorted(measurements, key=key)
