"""A frame with what goes on in it: boxes, points, paths, parts, mesh, particles, spin images."""

from collections import defaultdict, deque
from collections.abc import Sequence

import cv2
import numpy as np

from common.drawing.palette import FAINT, GREY, INK, PAPER, WHITE, Colour, colour_of
from common.drawing.strokes import put_label, put_path, put_text
from common.geometry.transforms import apply, invert, project
from evaluation.gait.look import colour_of_point
from people4d.messages import F64, U8, CameraInfo, PersonGait
from services.gait.cascade import GaitEstimate
from services.gait.people import Found, Scene
from services.gait.surface.mesh import Surface
from services.gait.surface.spin_image import SpinConfig, spin_images

HEIGHT_PX = 480  # of the whole picture
SIDE_PX = 300  # of the panel beside the frame
SPIN_PX = 56  # of a spin image
GAP_PX = 4
PATH_S = 2.0  # of a path behind its point
NEAREST_M = 0.2
MARGIN = 0.08  # about a body in its panel
SUN = np.array([-0.4, -0.6, -0.7])  # where the light on meshes comes from, optical frame


class Viewer:
    """Draws frame after frame.

    Args:
        info: Calibration of the camera.
        spin: How spin images are made.
    """

    def __init__(self, info: CameraInfo, spin: SpinConfig) -> None:
        self._info, self._spin = info, spin
        self._paths: dict[tuple[int, str], deque[tuple[int, F64]]] = defaultdict(deque)

    def see(self, scene: Scene, found: Sequence[Found]) -> None:
        """Take where points are, for the paths behind them; each frame once, drawn or not."""
        for one in found:
            for point in one.person.points:
                path = self._paths[one.person.id, point.name]
                if point.state == "measured":
                    path.append((scene.stamp_ns, point.position_m))
        for path in self._paths.values():
            while path and scene.stamp_ns - path[0][0] > PATH_S * 1e9:
                path.popleft()

    def draw(self, scene: Scene, found: Sequence[Found]) -> U8:
        """Return the picture of a frame that was seen: the frame, and the nearest body beside it.

        Args:
            scene: The frame.
            found: People in it, nearest first, with their details.

        Returns:
            HxWx3, red first.
        """
        scale = HEIGHT_PX / scene.rgb.shape[0]
        size = round(scene.rgb.shape[1] * scale), HEIGHT_PX
        frame = np.asarray(cv2.resize(scene.rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
        for one in found:
            self._person(frame, scene, one.person, scale)
        return np.concatenate([frame, self._beside(found)], axis=1)

    def _person(self, frame: U8, scene: Scene, person: PersonGait, scale: float) -> None:
        if person.box_xyxy_px is not None:
            box = np.clip(person.box_xyxy_px * scale, -9999, 9999)
            left, top, right, bottom = (round(float(side)) for side in box)
            cv2.rectangle(frame, (left, top), (right, bottom), colour_of(person.id), 2)
            put_label(frame, f"#{person.id}", (left, top), 12, colour_of(person.id))
        for point in person.points:
            path = self._paths[person.id, point.name]
            places = np.array([place for _, place in path]).reshape(-1, 3)
            pixels = self._pixels(scene, places) * scale
            if len(pixels) > 1:
                put_path(frame, pixels, colour_of_point(point.name), 2)
            here = self._pixels(scene, point.position_m[None]) * scale
            if point.state != "lost" and len(here):
                _dot(frame, here[0], colour_of_point(point.name), point.state == "measured")

    def _pixels(self, scene: Scene, points_m: F64) -> F64:
        optical = apply(invert(scene.fixed_from_optical), points_m)
        optical = optical[optical[:, 2] > NEAREST_M]
        return (
            np.clip(project(optical, self._info), -9999, 9999) if len(optical) else optical[:, :2]
        )

    def _beside(self, found: Sequence[Found]) -> U8:
        """Draw the nearest body that has a mesh: mesh, particles, spin images."""
        panel = np.full((HEIGHT_PX, SIDE_PX, 3), PAPER, np.uint8)
        for one in found:
            if one.estimate.surface is not None:
                top = HEIGHT_PX - SPIN_PX - 3 * GAP_PX - 12
                _body(panel[:top], one.estimate, one.estimate.surface)
                self._spins(panel[top:], one.estimate, one.estimate.surface)
                break
        return panel

    def _spins(self, panel: U8, estimate: GaitEstimate, surface: Surface) -> None:
        left = GAP_PX
        for name, point in estimate.points.items():
            if left + SPIN_PX > panel.shape[1]:
                break
            put_text(panel, name.replace("_", " "), (left, 12), 9, GREY)
            if point.state == "measured":
                vertex = surface.nearest(point.position_m)
                image = spin_images(surface, [vertex], self._spin)[0]
                shade = 255 - np.sqrt(image / max(float(image.max()), 1e-9)) * 255
                tile = cv2.resize(shade, (SPIN_PX, SPIN_PX), interpolation=cv2.INTER_NEAREST)
                place = panel[16 : 16 + SPIN_PX, left : left + SPIN_PX]
                place[:] = np.asarray(tile, np.uint8)[..., None]
                corner = (left + SPIN_PX - 1, 16 + SPIN_PX - 1)
                cv2.rectangle(panel, (left, 16), corner, colour_of_point(name), 1)
            left += SPIN_PX + GAP_PX


def _body(panel: U8, estimate: GaitEstimate, surface: Surface) -> None:
    """Draw a mesh with its particles and points, as large as there is room."""
    low, high = surface.pixels_px.min(axis=0), surface.pixels_px.max(axis=0)
    size = np.maximum(high - low, 1.0) * (1 + 2 * MARGIN)
    scale = float(min(panel.shape[1] / size[0], panel.shape[0] / size[1]))
    middle = np.array([panel.shape[1], panel.shape[0]]) / 2

    def placed(pixels: F64) -> F64:
        return np.asarray((pixels - (low + high) / 2) * scale + middle)

    vertices = placed(surface.pixels_px)
    start = np.repeat(np.arange(len(vertices)), np.diff(surface.indptr))
    once = start < surface.indices
    edges = np.stack([vertices[start[once]], vertices[surface.indices[once]]], axis=1)
    cv2.polylines(panel, list(_fixed(edges)), False, FAINT, 1, cv2.LINE_AA, 4)
    lit = np.clip(surface.normals @ (SUN / np.linalg.norm(SUN)), 0.0, 1.0)
    for (u, v), light in zip(vertices, lit, strict=True):
        shade = int(225 - 75 * light)
        colour = (shade - 8, shade, shade + 8)
        cv2.circle(panel, (round(u), round(v)), 1, colour, cv2.FILLED)
    for name, row_px in estimate.rows_px.items():
        at = round(float(placed(np.array([[0.0, row_px]]))[0, 1]))
        cv2.line(panel, (0, at), (panel.shape[1], at), FAINT, 1)
        put_text(panel, name, (GAP_PX, at + 12), 9, GREY)
    for name, particles in estimate.particles.items():
        for u, v in placed(particles[:, :2]):
            cv2.circle(panel, (round(u), round(v)), 2, colour_of_point(name), cv2.FILLED)
    for name, point in estimate.points.items():
        if point.state == "measured":
            at = surface.pixels_px[surface.nearest(point.position_m)]
            _dot(panel, placed(at[None])[0], colour_of_point(name), True)


def _fixed(points: F64) -> np.ndarray:
    return np.round(points * 16).astype(np.int32)  # 4 bits below a pixel


def _dot(image: U8, at: F64, colour: Colour, seen: bool) -> None:
    """Draw a point: full where it was seen, a ring where it is guessed."""
    where = round(float(at[0])), round(float(at[1]))
    cv2.circle(image, where, 6, WHITE if seen else INK, 2, cv2.LINE_AA)
    cv2.circle(image, where, 5, colour, cv2.FILLED if seen else 2, cv2.LINE_AA)
