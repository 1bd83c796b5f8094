"""Visualisation of a frame: boxes, points, trajectories, mesh, particles, spin images."""

from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import cv2
import numpy as np

from common.drawing.strokes import (
    FAINT,
    GREY,
    INK,
    PAPER,
    PEOPLE,
    WHITE,
    Colour,
    colour_of,
    put_label,
    put_path,
    put_text,
)
from common.geometry.transforms import apply, invert, project
from people4d.messages import F64, U8, CameraInfo, PersonGait
from services.gait.cascade import GaitEstimate
from services.gait.estimator import GaitFrame, GaitResult
from services.gait.points.keypoints import HEAD, LEFT_FOOT, LEFT_HAND, RIGHT_FOOT, RIGHT_HAND
from services.gait.surface.mesh import BodyMesh
from services.gait.surface.spin_image import spin_images

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
SIDE_PX = 300  # Width of the panel at the right of the frame [px]
SPIN_PX = 56  # Side of a spin image [px]
GAP_PX = 4
TRAJECTORY_S = 2.0  # Duration of the drawn trajectory of a point [s]
NEAREST_M = 0.2  # Minimum depth of a drawn point [m]
MARGIN = 0.08  # Margin about a body in its panel [sizes of the body]
LIGHT = np.array([-0.4, -0.6, -0.7])  # Direction to the light, optical frame


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
        """Return the image (HxWx3) of an added frame, with the nearest body at its right.

        People are nearest first, with their details.
        """
        scale = HEIGHT_PX / frame.rgb.shape[0]
        size = round(frame.rgb.shape[1] * scale), HEIGHT_PX
        image = np.asarray(cv2.resize(frame.rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
        for one in results:
            self._draw_person(image, frame, one.person, scale)
        return np.concatenate([image, self._body_panel(results)], axis=1)

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

    def _body_panel(self, results: Sequence[GaitResult]) -> U8:
        """Draw the nearest body that has a mesh: mesh, particles, spin images."""
        panel = np.full((HEIGHT_PX, SIDE_PX, 3), PAPER, np.uint8)
        for one in results:
            if one.estimate.mesh is not None:
                top = HEIGHT_PX - SPIN_PX - 3 * GAP_PX - 12
                _draw_body(panel[:top], one.estimate, one.estimate.mesh)
                _draw_spin_images(panel[top:], one.estimate, one.estimate.mesh)
                break
        return panel


def _draw_spin_images(panel: U8, estimate: GaitEstimate, mesh: BodyMesh) -> None:
    left = GAP_PX
    for name, point in estimate.points.items():
        if left + SPIN_PX > panel.shape[1]:
            break
        put_text(panel, name.replace("_", " "), (left, 12), 9, GREY)
        if point.state == "measured":
            vertex = mesh.nearest(point.position_m)
            image = spin_images(mesh, [vertex])[0]
            shade = 255 - np.sqrt(image / max(float(image.max()), 1e-9)) * 255
            tile = cv2.resize(shade, (SPIN_PX, SPIN_PX), interpolation=cv2.INTER_NEAREST)
            area = panel[16 : 16 + SPIN_PX, left : left + SPIN_PX]
            area[:] = np.asarray(tile, np.uint8)[..., None]
            corner = (left + SPIN_PX - 1, 16 + SPIN_PX - 1)
            cv2.rectangle(panel, (left, 16), corner, point_colour(name), 1)
        left += SPIN_PX + GAP_PX


def _draw_body(panel: U8, estimate: GaitEstimate, mesh: BodyMesh) -> None:
    """Draw a mesh with its particles and points, scaled to the panel."""
    low, high = mesh.pixels_px.min(axis=0), mesh.pixels_px.max(axis=0)
    size = np.maximum(high - low, 1.0) * (1 + 2 * MARGIN)
    scale = float(min(panel.shape[1] / size[0], panel.shape[0] / size[1]))
    middle = np.array([panel.shape[1], panel.shape[0]]) / 2

    def in_panel(pixels: F64) -> F64:
        return np.asarray((pixels - (low + high) / 2) * scale + middle)

    vertices = in_panel(mesh.pixels_px)
    start = np.repeat(np.arange(len(vertices)), np.diff(mesh.indptr))
    once = start < mesh.indices
    edges = np.stack([vertices[start[once]], vertices[mesh.indices[once]]], axis=1)
    cv2.polylines(panel, list(_fixed(edges)), False, FAINT, 1, cv2.LINE_AA, 4)
    lit = np.clip(mesh.normals @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0)
    for (u, v), light in zip(vertices, lit, strict=True):
        shade = int(225 - 75 * light)
        colour = (shade - 8, shade, shade + 8)
        cv2.circle(panel, (round(u), round(v)), 1, colour, cv2.FILLED)
    for name, row_px in estimate.rows_px.items():
        at = round(float(in_panel(np.array([[0.0, row_px]]))[0, 1]))
        cv2.line(panel, (0, at), (panel.shape[1], at), FAINT, 1)
        put_text(panel, name, (GAP_PX, at + 12), 9, GREY)
    for name, particles in estimate.particles.items():
        for u, v in in_panel(particles[:, :2]):
            cv2.circle(panel, (round(u), round(v)), 2, point_colour(name), cv2.FILLED)
    for name, point in estimate.points.items():
        if point.state == "measured":
            at = mesh.pixels_px[mesh.nearest(point.position_m)]
            _draw_point(panel, in_panel(at[None])[0], point_colour(name), True)


def _fixed(points: F64) -> np.ndarray:
    return np.round(points * 16).astype(np.int32)  # 4 bits below a pixel


def _draw_point(image: U8, pixel: F64, colour: Colour, measured: bool) -> None:
    """Draw a point: filled if it is measured, a ring if it is predicted."""
    centre = round(float(pixel[0])), round(float(pixel[1]))
    cv2.circle(image, centre, 6, WHITE if measured else INK, 2, cv2.LINE_AA)
    cv2.circle(image, centre, 5, colour, cv2.FILLED if measured else 2, cv2.LINE_AA)
