"""Visualisation of a frame: boxes, points and trajectories."""

from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import cv2
import numpy as np

from common.drawing.strokes import (
    INK,
    PEOPLE,
    WHITE,
    Colour,
    colour_of,
    put_label,
    put_path,
)
from common.geometry.transforms import apply, invert, project
from people4d.messages import F64, U8, CameraInfo, PersonGait
from services.gait.estimator import GaitFrame, GaitResult
from services.gait.points.keypoints import HEAD, LEFT_FOOT, LEFT_HAND, RIGHT_FOOT, RIGHT_HAND

POINT_COLOURS: Mapping[str, Colour] = MappingProxyType(
    {
        HEAD: (240, 190, 20),
        LEFT_HAND: (38, 132, 255),
        RIGHT_HAND: (232, 70, 70),
        LEFT_FOOT: (20, 184, 200),
        RIGHT_FOOT: (222, 64, 160),
    }
)
HEIGHT_PX = 480  # Height of the image [px]
TRAJECTORY_S = 2.0  # Duration of the drawn trajectory of a point [s]
NEAREST_M = 0.2  # Minimum depth of a drawn point [m]


def point_colour(name: str) -> Colour:
    """Return the colour of a point by its name."""
    return POINT_COLOURS.get(name, PEOPLE[sum(name.encode()) % len(PEOPLE)])


class GaitViewer:
    """Draws frames with their results."""

    def __init__(self, info: CameraInfo) -> None:
        self._info = info
        self._trajectories: dict[tuple[int, str], deque[tuple[int, F64]]] = defaultdict(deque)

    def add_frame(self, frame: GaitFrame, results: Sequence[GaitResult]) -> None:
        """Add the points of a frame to the trajectories; each frame once, drawn or not."""
        for one in results:
            for point in one.person.points:
                trajectory = self._trajectories[one.person.id, point.name]
                if point.state == "measured":
                    trajectory.append((frame.stamp_ns, point.position_m))
        for trajectory in self._trajectories.values():
            while trajectory and frame.stamp_ns - trajectory[0][0] > TRAJECTORY_S * 1e9:
                trajectory.popleft()

    def draw(self, frame: GaitFrame, results: Sequence[GaitResult]) -> U8:
        """Return the image (HxWx3) of an added frame."""
        scale = HEIGHT_PX / frame.rgb.shape[0]
        size = round(frame.rgb.shape[1] * scale), HEIGHT_PX
        image = np.asarray(cv2.resize(frame.rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
        for one in results:
            self._draw_person(image, frame, one.person, scale)
        return image

    def _draw_person(self, image: U8, frame: GaitFrame, person: PersonGait, scale: float) -> None:
        if person.box_xyxy_px is not None:
            box = np.clip(person.box_xyxy_px * scale, -9999, 9999)
            left, top, right, bottom = (round(float(side)) for side in box)
            cv2.rectangle(image, (left, top), (right, bottom), colour_of(person.id), 2)
            put_label(image, f"#{person.id}", (left, top), 12, colour_of(person.id))
        for point in person.points:
            trajectory = self._trajectories[person.id, point.name]
            positions = np.array([position for _, position in trajectory]).reshape(-1, 3)
            pixels = self._pixels(frame, positions) * scale
            if len(pixels) > 1:
                put_path(image, pixels, point_colour(point.name), 2)
            here = self._pixels(frame, point.position_m[None]) * scale
            if point.state != "lost" and len(here):
                _draw_point(image, here[0], point_colour(point.name), point.state == "measured")

    def _pixels(self, frame: GaitFrame, points_m: F64) -> F64:
        optical = apply(invert(frame.fixed_from_optical), points_m)
        optical = optical[optical[:, 2] > NEAREST_M]
        return (
            np.clip(project(optical, self._info), -9999, 9999) if len(optical) else optical[:, :2]
        )


def _draw_point(image: U8, pixel: F64, colour: Colour, measured: bool) -> None:
    """Draw a point: filled if it is measured, a ring if it is predicted."""
    centre = round(float(pixel[0])), round(float(pixel[1]))
    cv2.circle(image, centre, 6, WHITE if measured else INK, 2, cv2.LINE_AA)
    cv2.circle(image, centre, 5, colour, cv2.FILLED if measured else 2, cv2.LINE_AA)
