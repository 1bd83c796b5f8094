"""Annotations of people in images: a point on the torso, identity, yaw and occlusion."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from common.geometry.transforms import apply, deproject, wrap
from people4d.messages import F64, U16, CameraInfo

Hidden = Literal["no", "partly", "mostly"]
HIDDEN: tuple[Hidden, ...] = ("no", "partly", "mostly")
WINDOW_PX = 2  # [px] half side of the window around the mark in which depth is read
EDGE_PX = 5  # [px] half side of the window searched for an edge of depth
BODY_M = 0.35  # [m] maximum range of depths on one body in that window
READINGS_MIN = 5  # minimum number of valid pixels in the window


class Mark(msgspec.Struct, frozen=True):
    """One person in one image."""

    person: str
    u_px: float
    v_px: float
    # [deg] yaw of the chest: 0 away from the camera, 90 to the image's left; None: uncertain
    yaw_deg: Annotated[float, Meta(ge=-180, le=180)] | None
    hidden: Hidden = "no"  # occlusion


class _MarkedImage(msgspec.Struct, frozen=True):
    people: tuple[Mark, ...]
    frame: int


class _MarkFile(msgspec.Struct, frozen=True):
    marks: tuple[_MarkedImage, ...]
    doubtful_frames: tuple[int, ...] = ()


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

    def point_m(self, mark: Mark, depth_mm: U16) -> F64 | None:
        """Return the surface at a mark in the map, by the median depth.

        None without depth, and at an edge of depth.
        """
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


def read_frames(path: Path) -> dict[int, tuple[Mark, ...]]:
    """Return the annotations of a recording by frame, without doubtful frames."""
    content = msgspec.json.decode(path.read_bytes(), type=_MarkFile)
    frames = {image.frame: image.people for image in content.marks}
    return {
        frame: people for frame, people in frames.items() if frame not in content.doubtful_frames
    }
