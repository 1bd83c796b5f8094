"""Where points of a person's surface truly are, followed over time, and the steps truly made.

A mark is the vertex of the body's mesh that was nearest to the marked point; it stays on the skin
or cloth however the person moves.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import apply
from lab.truth.frames import in_image, project_visible
from lab.world import World
from people4d.messages import F32, F64, U8

Vertices = npt.NDArray[np.int64]
BEFORE_M = 0.02  # what is nearer than a mark by more than this hides it


@dataclass(frozen=True)
class Footfall:
    """A foot that came down."""

    time_s: float  # since the beginning of the scenario
    side: int  # 0 left, 1 right
    place_m: F64  # 2, x and y of the ankle while the foot stands, frame: map


def mark(world: World, person: int, t_s: float, points_m: F64) -> Vertices:
    """Return the vertices of a body nearest to points.

    Args:
        world: What is before the camera.
        person: Number of the person in the scenario.
        t_s: Time at which the points are marked.
        points_m: Mx3, frame: map.
    """
    vertices = world.meshes(t_s)[person].vertices_m
    offsets = points_m[:, None] - vertices
    return np.asarray(np.argmin(np.einsum("mvi,mvi->mv", offsets, offsets), axis=1))


def places_m(world: World, t_s: float, marks: Sequence[Vertices]) -> list[F64]:
    """Return where marks are at a time: Mx3 for each person, optical frame.

    Args:
        world: What is before the camera.
        t_s: Time.
        marks: For each person of the scenario.
    """
    optical_from_map = world.optical_from_map(t_s)
    pairs = zip(world.meshes(t_s), marks, strict=True)
    return [apply(optical_from_map, mesh.vertices_m[chosen]) for mesh, chosen in pairs]


def seen(world: World, points_m: F64, depth_m: F32, owners: U8, person: int) -> U8:
    """Tell which marks the camera sees: 1 owned by the person at its pixel and not hidden there.

    Args:
        world: What is before the camera.
        points_m: Mx3, from `places_m`.
        depth_m: HxW, true depth.
        owners: HxW, as in `DepthView`.
        person: Number of the person in the scenario.
    """
    pixels = project_visible(points_m, world.info)
    visible = in_image(pixels, world.info)
    column, row = np.rint(pixels[visible]).astype(int).T
    own = owners[row, column] == person + 1
    visible[visible] = own & (depth_m[row, column] > points_m[visible, 2] - BEFORE_M)
    return visible.astype(np.uint8)


def footfalls(world: World, person: int) -> list[Footfall]:
    """Return when and where a person's feet came down in the time of the scenario, in order."""
    duration_s = world.scenario.duration_s
    found = [
        Footfall(float(down_s), side, place[:2])
        for side, foot in enumerate(world.motions[person].feet)
        for down_s, place in zip(foot.down_s, foot.place, strict=True)
        if 0 <= down_s <= duration_s
    ]
    return sorted(found, key=lambda footfall: footfall.time_s)
