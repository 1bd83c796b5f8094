"""Messages about people: detections, appearance, tracks and motion-capture truth."""

from typing import ClassVar, Literal

import msgspec
import numpy as np

from people4d.messages.base import (
    F32,
    F64,
    U8,
    Message,
    check_finite,
    check_name,
    check_shape,
    check_size,
)


class Mask(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Pixels of one person inside a window of the image."""

    x_px: int  # [px] left edge of the window
    y_px: int  # [px] top edge of the window
    width: int  # [px] of the window
    height: int  # [px] of the window
    bits: bytes  # row-major, 1 bit a pixel, highest bit first, padded with 0 at the end

    def __post_init__(self) -> None:
        """Check that the window is filled exactly."""
        if min(self.x_px, self.y_px) < 0 or min(self.width, self.height) < 1:
            raise ValueError("mask: expected a window in the image, got a negative or empty one")
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


class Detection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One person in one frame."""

    box_xyxy_px: F32  # [px] 4: left, top, right, bottom; may reach beyond the image
    score: float  # detection confidence, 0 to 1
    keypoints: F32 | None = None  # [px] 17x3: u, v, confidence (0 to 1), COCO order; absent if none
    mask: Mask | None = None  # instance mask; absent if the model gives none
    position_m: F64 | None = None  # [m] 3, frame: camera optical; absent if depth gave none
    # [m^2] 3x3 covariance of position_m, frame: camera optical; absent if not told
    position_covariance_m2: F64 | None = None
    heading: F64 | None = None  # 3, unit, frame: camera optical; way the chest faces, or absent
    heading_sigma_rad: float | None = None  # [rad] standard deviation about the vertical, or absent

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        check_shape("box_xyxy_px", self.box_xyxy_px, (4,))
        check_finite("box_xyxy_px", self.box_xyxy_px)
        check_shape("keypoints", self.keypoints, (17, 3))
        check_shape("position_m", self.position_m, (3,))
        check_finite("keypoints, position_m", self.keypoints, self.position_m)
        self._check_covariance()
        check_shape("heading", self.heading, (3,))
        check_finite("heading, heading_sigma_rad", self.heading, self.heading_sigma_rad)
        with np.errstate(over="ignore"):
            length = 1.0 if self.heading is None else float(np.linalg.norm(self.heading))
        if abs(length - 1) > 1e-3:
            raise ValueError(f"heading: expected unit length, got {length}")
        if self.heading_sigma_rad is not None and self.heading_sigma_rad <= 0:
            raise ValueError(f"heading_sigma_rad: expected > 0, got {self.heading_sigma_rad}")
        if not 0 <= self.score <= 1:
            raise ValueError(f"score: expected 0 to 1, got {self.score}")

    def _check_covariance(self) -> None:
        covariance = self.position_covariance_m2
        check_shape("position_covariance_m2", covariance, (3, 3))
        check_finite("position_covariance_m2", covariance)
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

    camera: str  # name of the camera
    frame_id: str  # optical frame that positions are in
    model: str  # name of the model that found them
    width: int  # [px] of the image
    height: int  # [px] of the image
    detections: tuple[Detection, ...] = ()  # in no particular order; other messages refer by index
    detector: str = ""  # process that found them; empty: not told
    replicas: tuple[
        str, ...
    ] = ()  # processes that share the frames by turns now, this one included

    def __post_init__(self) -> None:
        """Check names."""
        super().__post_init__()
        check_name("camera", self.camera)
        check_name("frame_id", self.frame_id)
        check_size(self.width, self.height)


class Crop(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The picture of one detected person."""

    detection: int  # index into Detections.detections of the same camera and stamp
    rgb: U8  # HxWx3, red first, the box cut to the image
    mask: U8 | None = None  # HxW, non-zero = person; absent if the model gives none
    keypoints: F32 | None = None  # [px] 17x3 in the crop: u, v, confidence; absent if none

    def __post_init__(self) -> None:
        """Check shapes."""
        check_shape("rgb", self.rgb, (None, None, 3))
        check_shape("mask", self.mask, self.rgb.shape[:2])
        check_shape("keypoints", self.keypoints, (17, 3))
        if 0 in self.rgb.shape or self.detection < 0:
            raise ValueError(
                f"crop: expected pixels and an index >= 0, got rgb of shape {self.rgb.shape} and "
                f"index {self.detection}"
            )


class Crops(Message, frozen=True, kw_only=True):
    """Pictures of the people of one frame, for re-identification; sent for empty frames too."""

    VERSION: ClassVar[int] = 2

    camera: str  # name of the camera
    crops: tuple[Crop, ...] = ()  # one for each detection whose box meets the image

    def __post_init__(self) -> None:
        """Check the name."""
        super().__post_init__()
        check_name("camera", self.camera)


class Embeddings(Message, frozen=True, kw_only=True):
    """Appearance of the people of one frame."""

    camera: str  # name of the camera
    model: str  # name of the embedder; only embeddings of one model compare
    detections: tuple[int, ...]  # N indices into Detections.detections of the same camera and stamp
    vectors: F32  # NxD, unit length; cosine distance is 1 - a.b

    def __post_init__(self) -> None:
        """Check that each detection has one vector."""
        super().__post_init__()
        check_name("camera", self.camera)
        if min(self.detections, default=0) < 0:
            raise ValueError(f"detections: expected indices >= 0, got {min(self.detections)}")
        check_shape("vectors", self.vectors, (len(self.detections), None))
        check_finite("vectors", self.vectors)


class Track(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One person over time, in the frame that Tracks names."""

    id: int  # identity, >= 1, never given to another person by a running tracker
    state: Literal["tentative", "confirmed", "lost"]  # lost: predicted, not seen in this frame
    position_m: F64  # [m] 3, frame: Tracks.frame_id
    velocity_mps: F64  # [m/s] 3, frame: Tracks.frame_id
    covariance: F64  # [m, m/s] 6x6 of position and velocity, frame: Tracks.frame_id
    yaw_rad: float | None  # [rad] way faced, 0 = +x, counter-clockwise, (-pi, pi]; absent: unknown
    hits: int  # frames in which the person was matched
    age: int  # frames since the track began
    time_since_update_s: float  # [s] since the last match, 0 if matched in this frame
    detection: int | None  # index into Detections.detections of this stamp; absent if not matched
    score: float  # confidence of the last matched detection, 0 to 1
    # How the person came by the id when they were seen last. new: told for the first time;
    # continued: from the frame before; reidentified: they left and are known again; refused: new,
    # since somebody known looks like them but it is not sure. Absent: the tracker does not tell
    identity: Literal["new", "continued", "reidentified", "refused"] | None = None
    identity_confidence: float | None = None  # of that decision, 0 to 1; absent: not told
    identity_reason: str = ""  # why the id was given, when it was given; empty: not told

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        check_shape("position_m", self.position_m, (3,))
        check_shape("velocity_mps", self.velocity_mps, (3,))
        check_shape("covariance", self.covariance, (6, 6))
        check_finite("position_m, velocity_mps", self.position_m, self.velocity_mps)
        check_finite("covariance, yaw_rad", self.covariance, self.yaw_rad)
        check_finite("time_since_update_s", self.time_since_update_s)
        if self.id < 1 or min(self.hits, self.age, self.detection or 0) < 0:
            raise ValueError(
                "id, hits, age, detection: expected id >= 1 and no negative number, got "
                f"{self.id}, {self.hits}, {self.age}, {self.detection}"
            )
        if not 0 <= self.score <= 1:
            raise ValueError(f"score: expected 0 to 1, got {self.score}")
        if self.identity_confidence is not None and not 0 <= self.identity_confidence <= 1:
            raise ValueError(
                f"identity_confidence: expected 0 to 1, got {self.identity_confidence}"
            )


class Tracks(Message, frozen=True, kw_only=True):
    """The people around the robot: one message for every frame, empty ones too."""

    VERSION: ClassVar[int] = 2

    frame_id: str  # frame that people are in, "map" unless configured otherwise
    tracker: str  # name of the tracking method
    camera: str  # camera whose frame caused this message
    tracks: tuple[Track, ...] = ()  # confirmed and lost tracks, and tentative ones if configured

    def __post_init__(self) -> None:
        """Check names."""
        super().__post_init__()
        check_name("frame_id", self.frame_id)
        check_name("camera", self.camera)


class ImageTrack(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One person over time, in the image of one camera."""

    id: int  # identity, >= 1; the same person has it in Tracks, where their place is known
    state: Literal["tentative", "confirmed", "lost"]  # lost: predicted, not seen in this frame
    box_xyxy_px: F64  # [px] 4: left, top, right, bottom, filtered; may reach beyond the image
    hits: int  # frames in which the person was matched
    time_since_update_s: float  # [s] since the last match, 0 if matched in this frame
    detection: int | None  # index into Detections.detections of this stamp; absent if not matched
    score: float  # confidence of the last matched detection, 0 to 1

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        check_shape("box_xyxy_px", self.box_xyxy_px, (4,))
        check_finite("box_xyxy_px, time_since_update_s", self.box_xyxy_px, self.time_since_update_s)
        if self.id < 1 or min(self.hits, self.detection or 0) < 0:
            raise ValueError(
                "id, hits, detection: expected id >= 1 and no negative number, got "
                f"{self.id}, {self.hits}, {self.detection}"
            )
        if not 0 <= self.score <= 1:
            raise ValueError(f"score: expected 0 to 1, got {self.score}")


class ImageTracks(Message, frozen=True, kw_only=True):
    """The people in the image of one camera, whether or not their place is known.

    Only trackers that follow boxes send it: one message for every frame, empty ones too.
    """

    VERSION: ClassVar[int] = 2

    camera: str  # name of the camera
    tracker: str  # name of the tracking method
    width: int  # [px] of the image
    height: int  # [px] of the image
    tracks: tuple[ImageTrack, ...] = ()  # confirmed and lost, and tentative ones if configured

    def __post_init__(self) -> None:
        """Check names."""
        super().__post_init__()
        check_name("camera", self.camera)
        check_size(self.width, self.height)


class TruthPerson(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One person as motion capture sees them."""

    id: str  # identity in the motion-capture system
    position_m: F64  # [m] 3, torso, frame: Truth.frame_id
    velocity_mps: F64 | None = None  # [m/s] 3, frame: Truth.frame_id; absent if unknown
    yaw_rad: float | None = None  # [rad] of the chest, 0 = +x, counter-clockwise; absent if unknown
    path_yaw_rad: float | None = None  # [rad] of the way walked, likewise; absent if unknown

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        check_shape("position_m", self.position_m, (3,))
        check_shape("velocity_mps", self.velocity_mps, (3,))
        check_finite("position_m, velocity_mps", self.position_m, self.velocity_mps)
        check_finite("yaw_rad, path_yaw_rad", self.yaw_rad, self.path_yaw_rad)


class Truth(Message, frozen=True, kw_only=True):
    """People from motion capture."""

    frame_id: str  # frame that positions are in
    people: tuple[TruthPerson, ...] = ()  # people captured at this stamp

    def __post_init__(self) -> None:
        """Check the name."""
        super().__post_init__()
        check_name("frame_id", self.frame_id)
