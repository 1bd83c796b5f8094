"""Annotations of people in images: a point on the torso, identity, yaw and occlusion."""

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from common.geometry.transforms import apply, deproject, wrap
from common.io.files import read_bytes, replace_file
from people4d.errors import SourceError
from people4d.messages import F64, U8, U16, CameraInfo
from services.detector.position.axis import BODY, surface_to_axis

Hidden = Literal["no", "partly", "mostly"]
HIDDEN: tuple[Hidden, ...] = ("no", "partly", "mostly")
MAX_BYTES = 2**25  # maximum size of a file
WINDOW_PX = 2  # [px] half side of the window around the mark in which depth is read
EDGE_PX = 5  # [px] half side of the window searched for an edge of depth
BODY_M = 0.35  # [m] maximum range of depths on one body in that window
READINGS_MIN = 5  # minimum number of valid pixels in the window


class Mark(msgspec.Struct, frozen=True, omit_defaults=True):
    """One person in one image."""

    person: Annotated[str, Meta(min_length=1, max_length=40)]
    u_px: Annotated[float, Meta(ge=0)]
    v_px: Annotated[float, Meta(ge=0)]
    # [deg] yaw of the chest: 0 away from the camera, 90 to the image's left; None: uncertain
    yaw_deg: Annotated[float, Meta(ge=-180, le=180)] | None
    hidden: Hidden = "no"  # occlusion
    cut: bool = False  # True: cut by the edge of the image
    head_only: bool = False  # True: the torso is not visible, the point is on the head


class MarkedImage(msgspec.Struct, frozen=True):
    """The people in one image, each at most once; empty without people."""

    frame: Annotated[int, Meta(ge=0)]  # index of the image in the recording
    people: tuple[Mark, ...]

    def __post_init__(self) -> None:
        """Check that no person has two marks."""
        if len({mark.person for mark in self.people}) < len(self.people):
            raise ValueError(f"frame {self.frame} has two marks of one person")


class Annotations(msgspec.Struct, frozen=True):
    """A file of annotations; its other fields describe it."""

    marks: tuple[MarkedImage, ...] = ()
    doubtful_frames: tuple[int, ...] = ()  # frames that are not evaluated
    recording: str = ""  # digest of the first image; empty: not checked
    split: Literal["", "tuning", "test"] = ""  # "test": people4d tune refuses the recording

    @property
    def frames(self) -> dict[int, tuple[Mark, ...]]:
        """Marks of each frame, without doubtful frames."""
        doubtful = set(self.doubtful_frames)
        return {one.frame: one.people for one in self.marks if one.frame not in doubtful}


@dataclass(frozen=True)
class MarkView:
    """The standing camera of the annotated images."""

    info: CameraInfo
    map_from_optical: F64  # 4x4

    def bearing_rad(self, mark: Mark) -> float:
        """Return the yaw of the line of sight to a mark, in the map."""
        ray = deproject((mark.u_px, mark.v_px), [1.0], self.info)[0]
        x, y, _ = self.map_from_optical[:3, :3] @ ray
        return math.atan2(y, x)

    def yaw_rad(self, mark: Mark) -> float | None:
        """Return the yaw of a marked person in the map."""
        if mark.yaw_deg is None:
            return None
        return wrap(self.bearing_rad(mark) + math.radians(mark.yaw_deg))

    def axis_m(self, mark: Mark, depth_mm: U16) -> F64 | None:
        """Return the axis of the body behind `point_m` in the map."""
        surface_m = self.point_m(mark, depth_mm)
        if surface_m is None:
            return None
        ray_m = surface_m - self.map_from_optical[:3, 3]
        relative_rad = None if mark.yaw_deg is None else math.radians(mark.yaw_deg)
        behind_m = surface_to_axis(relative_rad, BODY)
        moved: F64 = surface_m + ray_m * behind_m / math.hypot(ray_m[0], ray_m[1])
        return moved

    def point_m(self, mark: Mark, depth_mm: U16) -> F64 | None:
        """Return the surface at a mark in the map, by median depth; None at an edge of depth."""
        readings_mm = _readings(mark, depth_mm, WINDOW_PX)
        if len(readings_mm) < READINGS_MIN:
            return None
        near_mm, far_mm = np.percentile(_readings(mark, depth_mm, EDGE_PX), [10, 90])
        if far_mm - near_mm > 1000 * BODY_M:
            return None
        depth_m = float(np.median(readings_mm)) / 1000
        point_m = deproject((mark.u_px, mark.v_px), [depth_m], self.info)[0]
        return np.asarray(apply(self.map_from_optical, point_m))


def _readings(mark: Mark, depth_mm: U16, reach_px: int) -> U16:
    """Return the valid depths in a window around a mark [mm]."""
    u, v = round(mark.u_px), round(mark.v_px)
    rows, columns = (slice(max(at - reach_px, 0), at + reach_px + 1) for at in (v, u))
    window = depth_mm[rows, columns]
    return window[window > 0]


def read_annotations(path: Path) -> Annotations:
    """Read a file of annotations; SourceError if the file cannot be read, or has other content."""
    return _read(path)[0]


def read_frames(path: Path) -> dict[int, tuple[Mark, ...]]:
    """Return the annotations of a recording by frame, without doubtful frames."""
    return read_annotations(path).frames


def write_marks(path: Path, image: MarkedImage, digest: str) -> None:
    """Replace the marks of one image in a file, or begin the file; other fields stay.

    SourceError if the file cannot be read or written, or annotates another recording.
    """
    old, fields = _read(path) if path.exists() else (Annotations(), {})
    check_recording(path, old, digest)
    images = {one.frame: one for one in old.marks} | {image.frame: image}
    fields |= {"recording": msgspec.Raw(msgspec.json.encode(digest))}
    fields.pop("marks", None)
    lines = [f"{json.dumps(name)}: {bytes(value).decode()}," for name, value in fields.items()]
    marks = [msgspec.json.encode(images[frame]).decode() for frame in sorted(images)]
    text = "\n".join(["{", *lines, '"marks": [', ",\n".join(marks), "]", "}", ""])
    try:
        replace_file(path, text.encode())
    except OSError as error:
        raise SourceError(f"{path} cannot be written: {error.strerror}") from error


def check_recording(path: Path, annotations: Annotations, digest: str) -> None:
    """Check that annotations are of the recording with a digest; SourceError if not."""
    if annotations.recording not in ("", digest):
        raise SourceError(
            f"{path} annotates another recording: expected first image {digest}, "
            f"got {annotations.recording}",
            "Name the recording that was annotated.",
        )


def digest_of(rgb: U8) -> str:
    """Return the digest of a recording by its first image."""
    return hashlib.sha256(rgb.tobytes()).hexdigest()[:16]


def _read(path: Path) -> tuple[Annotations, dict[str, msgspec.Raw]]:
    try:
        data = read_bytes(path, MAX_BYTES)
        fields = msgspec.json.decode(data, type=dict[str, msgspec.Raw])
        return msgspec.json.decode(data, type=Annotations), fields
    except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SourceError(
            f"{path} is no file of annotations: {error}", "people4d annotate writes one."
        ) from error
