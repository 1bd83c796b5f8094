"""A map from above with the trajectories of people."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from common.drawing.strokes import FAINT, GREY, PAPER, colour_of, put_label, put_path, put_text
from people4d.messages import F64, U8

MARGIN_M = 0.5
LEAST_M = 3.0  # side of the smallest map [m]
MOST_M = 200.0  # maximum distance of a drawn point [m]
WEDGE_M = 0.6  # length of the wedge of a camera [m]


@dataclass(frozen=True, slots=True)
class Trajectories:
    """Trajectories and cameras of a map, all in one frame, x forward (up), y left."""

    tracks: Mapping[int, F64] = field(default_factory=dict)  # [m] paths (Nx2) by track id
    truth: Mapping[str, F64] = field(default_factory=dict)  # [m] paths (Nx2) by person
    cameras: Sequence[F64] = ()  # 4x4, frame_from_optical
    frame_id: str = "map"


def draw_map(trajectories: Trajectories, width: int, height: int) -> U8:
    """Draw trajectories of tracks in their colours over the truth in grey, HxWx3, red first."""
    image = np.full((height, width, 3), PAPER, np.uint8)
    scale = _Scale.fit(trajectories, width, height)
    _draw_grid(image, scale)
    for camera in trajectories.cameras:
        _draw_camera(image, scale, camera)
    for path in trajectories.truth.values():
        put_path(image, scale.pixels(path), GREY, 4)
    for track, path in trajectories.tracks.items():
        put_path(image, scale.pixels(path), colour_of(track), 2)
    for track, path in trajectories.tracks.items():
        u, v = scale.pixels(path[-1:])[0]
        cv2.circle(image, (round(u), round(v)), 5, colour_of(track), cv2.FILLED, cv2.LINE_AA)
        put_label(image, f"#{track}", (u + 7, v - 4), 13, colour_of(track))
    legend = f"{trajectories.frame_id}: x up, y left" + (
        ", truth grey" if trajectories.truth else ""
    )
    put_label(image, legend, (width, 0), 13, PAPER)
    return image


@dataclass(frozen=True, slots=True)
class _Scale:
    """Scale from metres to pixels."""

    centre_m: F64  # 2, x and y in the middle of the image
    px_per_m: float
    centre_px: F64  # 2

    @classmethod
    def fit(cls, trajectories: Trajectories, width: int, height: int) -> "_Scale":
        paths = [
            *trajectories.tracks.values(),
            *trajectories.truth.values(),
            *(c[None, :2, 3] for c in trajectories.cameras),
        ]
        points = np.concatenate([np.zeros((0, 2)), *paths])
        points = points[np.abs(points).max(axis=1, initial=0) < MOST_M]
        low, high = (
            (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
        )
        x_m, y_m = np.maximum(high - low + 2 * MARGIN_M, LEAST_M)
        return cls(
            (low + high) / 2, float(min(width / y_m, height / x_m)), np.array([width, height]) / 2
        )

    def pixels(self, points_m: F64) -> F64:
        """Return Nx2 pixels of Nx2 metres: +x is up, +y is left."""
        moved = (np.clip(points_m, -MOST_M, MOST_M) - self.centre_m) * self.px_per_m
        return self.centre_px - moved[:, ::-1]

    def range_m(self) -> tuple[F64, F64]:
        """Return lowest and highest x and y in the image."""
        half = self.centre_px[::-1] / self.px_per_m
        return self.centre_m - half, self.centre_m + half


def _draw_grid(image: U8, scale: _Scale) -> None:
    """Draw a 1 m grid, coarser on a large map, with x and y."""
    low, high = scale.range_m()
    step = max(1, round(60 / scale.px_per_m))
    for axis in (0, 1):
        for metre in range(int(np.ceil(low[axis])), int(high[axis]) + 1):
            if metre % step:
                continue
            ends = np.stack([low, high])
            ends[:, axis] = metre
            path = scale.pixels(ends)
            put_path(image, path, FAINT, 1)
            u, v = path[0] if axis else path[1]
            at = (u + 4, image.shape[0] - 6.0) if axis else (4.0, v - 4)
            if at[1] > 14:  # otherwise cut off at the upper edge
                put_text(image, f"{metre} m", at, 11, GREY)


def _draw_camera(image: U8, scale: _Scale, frame_from_optical: F64) -> None:
    """Draw a camera as a wedge along its optical axis."""
    here, forward = frame_from_optical[:2, 3], frame_from_optical[:2, 2]
    length = float(np.linalg.norm(forward))
    if length < 1e-3:  # straight up or down
        return
    forward = forward / length * WEDGE_M
    side = np.array([-forward[1], forward[0]]) * 0.52  # tan(55 / 2 degrees)
    corners = scale.pixels(np.stack([here, here + forward + side, here + forward - side]))
    fixed = np.round(corners * 16).astype(np.int32)
    cv2.fillPoly(image, [fixed], FAINT, cv2.LINE_AA, 4)
    put_path(image, corners[[0, 1, 2, 0]], GREY, 1)
