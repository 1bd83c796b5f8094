"""Messages about people: detections, appearance, tracks and motion-capture truth."""

import math
from typing import Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta

from people4d.messages.base import (
    F32,
    F64,
    MAX_M,
    MAX_PX,
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
    PositiveInt,
    Probability,
    Radians,
    Record,
    RgbImage,
    Text,
    Vector3,
    check_size,
)
from people4d.validation import Magnitude, Shape

DETECTIONS_MAX = 512  # maximum number of detections in a frame
CLEARLY_POSITIVE = 1e-9  # minimum ratio of eigenvalues at which rounding errors are small


class Mask(Record, frozen=True, kw_only=True):
    """Pixels of one person inside a window of the image."""

    x_px: Index  # [px] left edge of the window
    y_px: Index  # [px] top edge of the window
    width: ImageSide  # [px] width of the window
    height: ImageSide  # [px] height of the window
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

    box_xyxy_px: Box  # [px] left, top, right, bottom; may reach beyond the image
    score: Probability  # detection confidence
    # probability of a person, by the image in colour and depth around it; absent if unknown
    person: Probability | None = None
    # [px] u, v, confidence (0 to 1), COCO order; absent if none
    keypoints: Keypoints | None = None
    # [m] depth of the surface at each keypoint, 0 if unread; absent if unknown
    keypoint_depths_m: Annotated[F32, Shape(17), Magnitude(MAX_M)] | None = None
    mask: Mask | None = None  # instance mask; absent if the model gives none
    position_m: Vector3 | None = None  # [m] frame: camera optical; absent if depth gave none
    # [m^2] covariance of position_m, frame: camera optical; absent if unknown
    position_covariance_m2: Matrix3 | None = None
    # unit vector in which the chest points, frame: camera optical; absent if unknown
    heading: Vector3 | None = None
    # [rad] standard deviation about the vertical; absent if unknown
    heading_sigma_rad: Annotated[float, Meta(gt=0, le=100)] | None = None

    def __post_init__(self) -> None:
        """Check the fields, and that the heading is a unit vector."""
        super().__post_init__()
        _check_covariance(self.position_m, self.position_covariance_m2)
        length = 1.0 if self.heading is None else math.hypot(*self.heading.tolist())
        if abs(length - 1) > 1e-3:
            raise ValueError(f"heading: expected unit length, got {length}")


def _check_covariance(position_m: F64 | None, covariance: F64 | None) -> None:
    """Check that a covariance has a position, and is symmetric and positive definite.

    Raises:
        ValueError: It is not.
    """
    if covariance is None:
        return
    if position_m is None:
        raise ValueError("position_covariance_m2: expected with the position only")
    if not _is_symmetric_positive_definite(covariance):
        raise ValueError("position_covariance_m2: expected symmetric and positive definite")


def _is_symmetric_positive_definite(matrix: F64) -> bool:
    """Check a matrix (3x3) of finite numbers."""
    (a, b, c), (b_, d, e), (c_, e_, f) = matrix.tolist()
    if (b, c, e) != (b_, c_, e_):
        return False
    # By the leading minors, which takes a tenth of the time, unless rounding could decide: the
    # least eigenvalue is at least the determinant over the square of the trace.
    minor, trace = a * d - b * b, a + d + f
    determinant = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    if a > 0 and minor > 0 and determinant > CLEARLY_POSITIVE * trace**3:
        return True
    try:
        with np.errstate(all="ignore"):
            return bool(np.linalg.eigvalsh(matrix)[0] > 0)
    except np.linalg.LinAlgError:  # overflow
        return False


class Detections(Message, frozen=True, kw_only=True):
    """All people found in one frame; sent for empty frames too."""

    VERSION: ClassVar[int] = 2

    camera: Name  # name of the camera
    frame_id: Name  # optical frame of positions
    model: Text  # name of the detection model
    width: ImageSide  # [px] width of the image
    height: ImageSide  # [px] height of the image
    # in no particular order; other messages refer to them by index
    detections: Annotated[tuple[Detection, ...], Meta(max_length=DETECTIONS_MAX)] = ()
    detector: Text = ""  # instance of the detector; empty: unknown
    # instances that share the frames, including this one
    replicas: tuple[Text, ...] = ()
    crops: Count | None = None  # number of people in Crops of this frame; absent: unknown

    def __post_init__(self) -> None:
        """Check the fields and the number of pixels."""
        super().__post_init__()
        check_size(self.width, self.height)

    def at(self, index: int | None) -> Detection | None:
        """Return the detection with an index; None if there is none."""
        if index is None or index >= len(self.detections):
            return None
        return self.detections[index]


# Colour of occluded pixels of a crop: the mean of ImageNet
HIDDEN_RGB = (124, 116, 104)


class Crop(Record, frozen=True, kw_only=True):
    """The image of one detected person."""

    detection: Index  # index into Detections.detections of the same camera and stamp
    # red first, part of the image in the box; HIDDEN_RGB where the person is occluded
    rgb: RgbImage
    # non-zero = person; absent if the model gives none
    mask: Annotated[U8, Shape("H", "W")] | None = None
    keypoints: Keypoints | None = None  # [px] in the crop: u, v, confidence; absent if none

    def __post_init__(self) -> None:
        """Check the fields, and that image and mask have the same size."""
        super().__post_init__()
        if self.mask is not None and self.mask.shape != self.rgb.shape[:2]:
            raise ValueError(
                f"mask: expected the size of rgb, {self.rgb.shape[:2]}, got {self.mask.shape}"
            )


class Crops(Message, frozen=True, kw_only=True):
    """Image crops of the people in one frame, for re-identification; empty frames included."""

    VERSION: ClassVar[int] = 2

    camera: Name  # name of the camera
    # one for each detection whose box meets the image; every 0.25 s for a person apart from others
    crops: tuple[Crop, ...] = ()


class Embeddings(Message, frozen=True, kw_only=True):
    """Appearance of the people of one frame."""

    camera: Name  # name of the camera
    model: Text  # name of the embedder; only embeddings of one model compare
    detections: tuple[
        Index, ...
    ]  # N indices into Detections.detections of the same camera and stamp
    # unit length; cosine distance is 1 - a.b
    vectors: Annotated[F32, Shape("N", "D"), Magnitude(1e3)]

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

    id: PositiveInt  # identity, unique for the run of the tracker
    state: Literal["tentative", "confirmed", "lost"]  # lost: predicted, not matched in this frame
    position_m: Vector3  # [m] frame: Tracks.frame_id
    velocity_mps: Vector3  # [m/s] frame: Tracks.frame_id
    covariance: Matrix6  # [m, m/s] of position and velocity, frame: Tracks.frame_id
    # [rad] yaw of the chest, 0 = +x, counter-clockwise, (-pi, pi]; absent if unknown
    yaw_rad: Radians | None
    hits: Count  # number of frames with a match
    age: Count  # number of frames since the track began
    time_since_update_s: float  # [s] since the last match, 0 if matched in this frame
    detection: Index | None  # index into Detections.detections of this stamp; absent if not matched
    score: Probability  # confidence of the last matched detection
    # source of the id at the last match. new: first match; continued: from the previous frame;
    # reidentified: matched after an absence. Absent if the tracker does not estimate it
    identity: Literal["new", "continued", "reidentified"] | None = None
    identity_confidence: Probability | None = None  # confidence of the identity; absent if unknown
    identity_reason: Text = ""  # reason of the identity decision; empty if unknown


class Tracks(Message, frozen=True, kw_only=True):
    """The people around the robot: one message for every frame, empty ones too.

    If frames stop, some more messages are predicted by the wall clock; the last of them is empty.
    """

    VERSION: ClassVar[int] = 2

    frame_id: Name  # frame of tracks, "map" unless configured otherwise
    tracker: Text  # name of the tracking method
    camera: Name  # camera whose frame caused this message
    tracks: tuple[Track, ...] = ()  # confirmed and lost tracks, and tentative ones if configured
    # True: without a frame, later frames may have earlier stamps; no tracks: people are unknown
    predicted: bool = False


class ImageTrack(Record, frozen=True, kw_only=True):
    """One person over time, in the image of one camera."""

    id: PositiveInt  # identity, as in Tracks if the position is known
    state: Literal["tentative", "confirmed", "lost"]  # lost: predicted, not matched in this frame
    # [px] left, top, right, bottom, filtered; may reach beyond the image
    box_xyxy_px: Annotated[F64, Shape(4), Magnitude(MAX_PX)]
    hits: Count  # number of frames with a match
    time_since_update_s: float  # [s] since the last match, 0 if matched in this frame
    detection: Index | None  # index into Detections.detections of this stamp; absent if not matched
    score: Probability  # confidence of the last matched detection


class ImageTracks(Message, frozen=True, kw_only=True):
    """The people in the image of one camera, with or without a known position.

    Only trackers of boxes publish it: one message for every frame, empty ones too.
    """

    VERSION: ClassVar[int] = 2

    camera: Name  # name of the camera
    tracker: Text  # name of the tracking method
    width: ImageSide  # [px] width of the image
    height: ImageSide  # [px] height of the image
    tracks: tuple[ImageTrack, ...] = ()  # confirmed and lost, and tentative ones if configured


class TruthPerson(Record, frozen=True, kw_only=True):
    """One person as measured by motion capture."""

    id: Text  # identity in the motion-capture system
    position_m: Vector3  # [m] torso, frame: Truth.frame_id
    velocity_mps: Vector3 | None = None  # [m/s] frame: Truth.frame_id; absent if unknown
    # [rad] yaw of the chest, 0 = +x, counter-clockwise; absent if unknown
    yaw_rad: Radians | None = None
    path_yaw_rad: Radians | None = None  # [rad] of the direction walked; absent if unknown


class Truth(Message, frozen=True, kw_only=True):
    """People from motion capture."""

    frame_id: Name  # frame of positions
    people: tuple[TruthPerson, ...] = ()  # people captured at this stamp
