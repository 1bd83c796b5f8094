"""False people in rendered rooms: tracks of furniture, of flat figures and of mannequins.

A view is one image of a random room, played with the noise of its depth sensor and of colour. A
flat figure looks like a person from the camera, with the depth of a board. A mannequin is a body
that never moves.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import repeat

import msgspec
import numpy as np

from benchmarks.lib.intervals import poisson_rate
from benchmarks.lib.postures.images import GREY_SIGMA, play_messages
from benchmarks.lib.postures.objects import SHORT_S, Figure
from common.geometry.transforms import apply, invert
from evaluation.methods import read_method
from lab.camera.frames import transforms
from lab.camera.image_drift import ImageDrift
from lab.catalogue import load_scenario
from lab.depth.config import SENSORS
from lab.depth.sensor import DepthSensor
from lab.drawing.mesh import Mesh
from lab.drawing.renderer import Instant, Renderer, draw_surfaces
from lab.world import World
from people4d.messages import F64, Detections, Message, RgbdFrame
from services.detector.build import build as build_detector

HEADER = (
    "rooms",
    "views",
    "hours",
    "detections in 100 frames",
    "tracks, an hour",
    "not called objects, an hour",
)
ROOMS = ("office", "hall", "lab", "square")  # the square has no furniture
VIEW_S = 60.0  # duration of a view [s]
FRAMES = 6  # number of frames with their own noise, which repeat
RELIEF = 0.02  # depth of a flat figure relative to a body
SLOPE = 0.3  # maximum slope of a flat figure across the view


class Mannequins(World):
    """World whose people never move."""

    def meshes(self, t_s: float) -> tuple[Mesh, ...]:  # noqa: ARG002
        """Return the bodies at the start."""
        return super().meshes(0.0)


class FlatFigures(World):
    """World whose people are flat figures."""

    def meshes(self, t_s: float) -> tuple[Mesh, ...]:  # noqa: ARG002
        """Return the bodies at the start, each flattened towards a plane."""
        rng, pose = np.random.default_rng(self.seed), self.optical_from_map(0.0)
        return tuple(
            replace(mesh, vertices_m=flatten(mesh.vertices_m, pose, rng.uniform(-SLOPE, SLOPE)))
            for mesh in super().meshes(0.0)
        )


def flatten(points_m: F64, optical_from_map: F64, slope: float) -> F64:
    """Return points moved along their rays from the camera towards a plane through their mean."""
    optical_m = apply(optical_from_map, points_m)
    normal = np.array([slope, 0.0, 1.0])
    factor = (normal @ optical_m.mean(axis=0)) / (optical_m @ normal)
    factor += RELIEF * (1 - factor)
    return apply(invert(optical_from_map), optical_m * factor[:, None])


@dataclass(frozen=True)
class RoomKind:
    """Kind of rooms."""

    world: type[World]
    options: str  # options of the random scene
    rooms: Sequence[str]
    is_empty: bool  # True: without people's bodies
    duration_s: float = VIEW_S


KINDS = {
    "without furniture": RoomKind(World, "furniture=false", ROOMS, is_empty=True),
    "with desks, screens, chairs, partitions, cabinets": RoomKind(
        World, "furniture=true", ROOMS[:-1], is_empty=True
    ),
    "with two flat figures": RoomKind(FlatFigures, "people=2", ROOMS, is_empty=False),
    "with two mannequins": RoomKind(Mannequins, "people=2", ROOMS, False, SHORT_S),
}


def view_seeds(kind: RoomKind, views: int) -> range:
    """Return the seeds of the views of a kind; a tenth of them, at least one, with figures."""
    return range(views if kind.is_empty else max(1, views // 10))


def room_rows(views: int, pool: Executor) -> Iterator[list[str]]:
    """Yield a row for each kind of rooms, of a number of views."""
    for name, kind in KINDS.items():
        found = list(pool.map(play_view, repeat(name), view_seeds(kind, views)))
        figures = [figure for _, tracked in found for figure in tracked]
        persons = sum(figure.after_s is None for figure in figures)
        hours = len(found) * kind.duration_s / 3600
        yield [
            name,
            f"{len(found)}",
            f"{hours:.1f}",
            f"{100 * sum(count for count, _ in found) / len(found) / FRAMES:.1f}",
            _text(len(figures), hours),
            _text(persons, hours),
        ]


def play_view(name: str, seed: int) -> tuple[int, list[Figure]]:
    """Return the number of detections in the frames of a view, and the figure of each track."""
    kind, method = KINDS[name], read_method("best")
    room = kind.rooms[seed % len(kind.rooms)]
    scenario = load_scenario(f"random?room={room}&{kind.options}", seed)
    people = () if kind.is_empty else scenario.people
    world = kind.world(msgspec.structs.replace(scenario, people=people, duration_s=1.0), seed)
    detector = build_detector(method.detector)
    messages: list[Message] = [world.info, *transforms(world)]
    for message in messages:
        detector.handle(message, 0)
    for frame in _frames(world):
        messages += [m for m in detector.handle(frame, 0) if isinstance(m, Detections)]
    count = sum(len(m.detections) for m in messages if isinstance(m, Detections))
    return count, play_messages(method, messages, kind.duration_s) if count else []


def _frames(world: World) -> Iterator[RgbdFrame]:
    """Yield frames of the first view of a world, each with its own noise."""
    camera, info, pose = world.scenario.camera, world.info, world.optical_from_map(0.0)
    meshes, rng = world.meshes(0.0), np.random.default_rng(world.seed)
    instant, config = Instant(meshes, pose), SENSORS[camera.depth_sensor]
    drift = ImageDrift(camera.image, world.seed).at(0.0)
    rgb = Renderer(world.room, info, world.seed, samples=1).exposed([instant], 0, drift)
    surfaces = draw_surfaces([world.room.mesh, *meshes], pose, info, config)
    sensor = DepthSensor(config, info, world.seed)
    for index in range(FRAMES):
        noise = rng.standard_normal(rgb.shape, dtype=np.float32)
        noisy = (rgb + np.float32(GREY_SIGMA) * noise).clip(0, 255)
        stamp_ns = world.stamp_ns(index)
        depth_mm = sensor.measure(
            surfaces.depth_m, surfaces.right_depth_m, stamp_ns / 1e9, surfaces.light
        )
        yield RgbdFrame(
            stamp_ns=stamp_ns,
            sequence=index,
            camera=info.camera,
            rgb=noisy.astype(np.uint8),
            depth_mm=depth_mm,
        )


def _text(count: int, hours: float) -> str:
    """Return a count, and its rate with the interval."""
    return "{}, {:.1f} ({:.1f} to {:.1f})".format(count, *poisson_rate(count, hours))
