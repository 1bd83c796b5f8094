"""Messages about people: detections, appearance, tracks and motion-capture truth."""

from typing import Annotated, ClassVar, Literal

import numpy as np

from people4d.messages.base import (
    F32,
    F64,
    U8,
    Box,
    Count,
    ImageSide,
    Index,
    Keypoints,
    Matrix3,
    Matrix6,
    Message,
    Name,
    Positive,
    PositiveInt,
    Probability,
    Record,
    RgbImage,
    Vector3,
    check_size,
)
from people4d.validation import Shape


class Mask(Record, frozen=True, kw_only=True):
    """Pixels of one person inside a window of the image."""

    x_px: Index  # [px] left edge of the window
    y_px: Index  # [px] top edge of the window
    width: ImageSide  # [px] of the window
    height: ImageSide  # [px] of the window
    bits: bytes  # row-major, 1 bit a pixel, highest bit first, padded with 0 at the end

    def __post_init__(self) -> None:
        """Check that the window is filled exactly."""
        super().__post_init__()
        check_size(self.width, self.height)
        size = (self.width * self.height + 7) // 8
        if len(self.bits) != size:
            raise ValueError(f"bits: expected {size} bytes, got {len(self.bits)}")

    @classmethod
    def from_array(cls, window: U8, x_px: int = 0, y_px: int = 0) -> "Mask":
        """Pack a window of pixels (HxW, non-zero = person)."""
        height, width = window.shape
        bits = np.packbits(window != 0).tobytes()
        return cls(x_px=x_px, y_px=y_px, width=width, height=height, bits=bits)

    def window(self) -> U8:
        """Unpack to HxW, 1 = person."""
        flat = np.unpackbits(np.frombuffer(self.bits, np.uint8), count=self.width * self.height)
        return flat.reshape(self.height, self.width)


class Detection(Record, frozen=True, kw_only=True):
    """One person in one frame."""

    box_xyxy_px: Box  # [px] 4: left, top, right, bottom; may reach beyond the image
    score: Probability  # detection confidence, 0 to 1
    # [px] 17x3: u, v, confidence (0 to 1), COCO order; absent if none
    keypoints: Keypoints | None = None
    mask: Mask | None = None  # instance mask; absent if the model gives none
    position_m: Vector3 | None = None  # [m] 3, frame: camera optical; absent if depth gave none
    # [m^2] 3x3 covariance of position_m, frame: camera optical; absent if not told
    position_covariance_m2: Matrix3 | None = None
    heading: Vector3 | None = None  # 3, unit, frame: camera optical; way the chest faces, or absent
    # [rad] standard deviation about the vertical; absent if unknown
    heading_sigma_rad: Positive | None = None

    def __post_init__(self) -> None:
        """Check the fields, and that the heading is a unit vector."""
        super().__post_init__()
        self._check_covariance()
        with np.errstate(over="ignore"):
            length = 1.0 if self.heading is None else float(np.linalg.norm(self.heading))
        if abs(length - 1) > 1e-3:
            raise ValueError(f"heading: expected unit length, got {length}")

    def _check_covariance(self) -> None:
        covariance = self.position_covariance_m2
        if covariance is None:
            return
        if self.position_m is None:
            raise ValueError("position_covariance_m2: expected with position_m only")
        if np.any(covariance != covariance.T) or not _is_positive_definite(covariance):
            raise ValueError("position_covariance_m2: expected symmetric and positive definite")


def _is_positive_definite(matrix: F64) -> bool:
    try:
        with np.errstate(all="ignore"):
            return bool(np.linalg.eigvalsh(matrix)[0] > 0)
    except np.linalg.LinAlgError:  # numbers too large to tell
        return False


class Detections(Message, frozen=True, kw_only=True):
    """All people found in one frame; sent for empty frames too."""

    VERSION: ClassVar[int] = 2

    camera: Name  # name of the camera
    frame_id: Name  # optical frame that positions are in
    model: str  # name of the model that found them
    width: ImageSide  # [px] of the image
    height: ImageSide  # [px] of the image
    detections: tuple[Detection, ...] = ()  # in no particular order; other messages refer by index
    detector: str = ""  # process that found them; empty: not told
    replicas: tuple[
        str, ...
    ] = ()  # processes that share the frames by turns now, this one included

    def __post_init__(self) -> None:
        """Check the fields and the number of pixels."""
        super().__post_init__()
        check_size(self.width, self.height)


class Crop(Record, frozen=True, kw_only=True):
    """The picture of one detected person."""

    detection: Index  # index into Detections.detections of the same camera and stamp
    rgb: RgbImage  # HxWx3, red first, the box cut to the image
    # HxW, non-zero = person; absent if the model gives none
    mask: Annotated[U8, Shape(None, None)] | None = None
    keypoints: Keypoints | None = None  # [px] 17x3 in the crop: u, v, confidence; absent if none

    def __post_init__(self) -> None:
        """Check the fields, and that image and mask have the same size."""
        super().__post_init__()
        if self.mask is not None and self.mask.shape != self.rgb.shape[:2]:
            raise ValueError(
                f"mask: expected the size of rgb, {self.rgb.shape[:2]}, got {self.mask.shape}"
            )


class Crops(Message, frozen=True, kw_only=True):
    """Pictures of the people of one frame, for re-identification; sent for empty frames too."""

    VERSION: ClassVar[int] = 2

    camera: Name  # name of the camera
    crops: tuple[Crop, ...] = ()  # one for each detection whose box meets the image


class Embeddings(Message, frozen=True, kw_only=True):
    """Appearance of the people of one frame."""

    camera: Name  # name of the camera
    model: str  # name of the embedder; only embeddings of one model compare
    detections: tuple[
        Index, ...
    ]  # N indices into Detections.detections of the same camera and stamp
    vectors: Annotated[F32, Shape(None, None)]  # NxD, unit length; cosine distance is 1 - a.b

    def __post_init__(self) -> None:
        """Check the fields, and that each detection has one vector."""
        super().__post_init__()
        if len(self.vectors) != len(self.detections):
            raise ValueError(
                f"vectors: expected {len(self.detections)}, one a detection, "
                f"got {len(self.vectors)}"
            )


class Track(Record, frozen=True, kw_only=True):
    """One person over time, in the frame that Tracks names."""

    id: PositiveInt  # identity, >= 1, never given to another person by a running tracker
    state: Literal["tentative", "confirmed", "lost"]  # lost: predicted, not seen in this frame
    position_m: Vector3  # [m] 3, frame: Tracks.frame_id
    velocity_mps: Vector3  # [m/s] 3, frame: Tracks.frame_id
    covariance: Matrix6  # [m, m/s] 6x6 of position and velocity, frame: Tracks.frame_id
    yaw_rad: float | None  # [rad] way faced, 0 = +x, counter-clockwise, (-pi, pi]; absent: unknown
    hits: Count  # frames in which the person was matched
    age: Count  # frames since the track began
    time_since_update_s: float  # [s] since the last match, 0 if matched in this frame
    detection: Index | None  # index into Detections.detections of this stamp; absent if not matched
    score: Probability  # confidence of the last matched detection, 0 to 1
    # How the person came by the id when they were seen last. new: told for the first time;
    # continued: from the frame before; reidentified: they left and are known again; refused: new,
    # since somebody known looks like them but it is not sure. Absent: the tracker does not tell
    identity: Literal["new", "continued", "reidentified", "refused"] | None = None
    identity_confidence: Probability | None = None  # of that decision, 0 to 1; absent: not told
    identity_reason: str = ""  # why the id was given, when it was given; empty: not told


class Tracks(Message, frozen=True, kw_only=True):
    """The people around the robot: one message for every frame, empty ones too."""

    VERSION: ClassVar[int] = 2

    frame_id: Name  # frame that people are in, "map" unless configured otherwise
    tracker: str  # name of the tracking method
    camera: Name  # camera whose frame caused this message
    tracks: tuple[Track, ...] = ()  # confirmed and lost tracks, and tentative ones if configured


class ImageTrack(Record, frozen=True, kw_only=True):
    """One person over time, in the image of one camera."""

    id: PositiveInt  # identity, >= 1; the same person has it in Tracks, where their place is known
    state: Literal["tentative", "confirmed", "lost"]  # lost: predicted, not seen in this frame
    box_xyxy_px: Annotated[
        F64, Shape(4)
    ]  # [px] 4: left, top, right, bottom, filtered; may reach beyond the image
    hits: Count  # frames in which the person was matched
    time_since_update_s: float  # [s] since the last match, 0 if matched in this frame
    detection: Index | None  # index into Detections.detections of this stamp; absent if not matched
    score: Probability  # confidence of the last matched detection, 0 to 1


class ImageTracks(Message, frozen=True, kw_only=True):
    """The people in the image of one camera, whether or not their place is known.

    Only trackers that follow boxes send it: one message for every frame, empty ones too.
    """

    VERSION: ClassVar[int] = 2

    camera: Name  # name of the camera
    tracker: str  # name of the tracking method
    width: ImageSide  # [px] of the image
    height: ImageSide  # [px] of the image
    tracks: tuple[ImageTrack, ...] = ()  # confirmed and lost, and tentative ones if configured


class TruthPerson(Record, frozen=True, kw_only=True):
    """One person as motion capture sees them."""

    id: str  # identity in the motion-capture system
    position_m: Vector3  # [m] 3, torso, frame: Truth.frame_id
    velocity_mps: Vector3 | None = None  # [m/s] 3, frame: Truth.frame_id; absent if unknown
    yaw_rad: float | None = None  # [rad] of the chest, 0 = +x, counter-clockwise; absent if unknown
    path_yaw_rad: float | None = None  # [rad] of the way walked, likewise; absent if unknown


class Truth(Message, frozen=True, kw_only=True):
    """People from motion capture."""

    frame_id: Name  # frame that positions are in
    people: tuple[TruthPerson, ...] = ()  # people captured at this stamp
