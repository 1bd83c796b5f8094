"""Rooms: their furniture and their lights."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lab.drawing import furniture
from lab.drawing.furniture import Vector
from lab.drawing.mesh import Material, Mesh, join
from lab.drawing.solids import Finish, box, panel, srgb
from people4d.messages import F64

KEY = 301  # key of the random numbers
Seats = Sequence[tuple[float, float]]
DOWN: F64 = np.array([0.0, 0.0, -1.0])
INWARD: F64 = np.array([0.0, -1.0, 0.0])  # direction of light from windows
FLOORS = {
    Material.CONCRETE: [(140, 138, 132), (122, 122, 120)],
    Material.CARPET: [(84, 90, 102), (104, 88, 80), (88, 96, 86)],
}


@dataclass(frozen=True)
class Light:
    """A lamp or a window, small relative to its distance."""

    position_m: F64  # 3, frame: map
    towards: F64  # 3, unit vector of the light's axis; surfaces behind the light are not lit
    intensity: F64  # 3, red first; irradiance at 1 m on the axis
    radius_m: float  # radius of the surface; larger lights have softer shadows


@dataclass(frozen=True)
class Room:
    """A room without people."""

    mesh: Mesh  # surfaces, frame: map
    lights: tuple[Light, ...]
    low_m: F64  # 3, corner of the room
    high_m: F64  # 3, opposite corner
    # 6x3 linear reflectance of the walls at low x, high x, low y, high y, the floor and the ceiling
    walls: F64
    # brightness of the image; 1: a white sheet in the middle of the room is white
    exposure: float


def room_mesh(kind: str, seed: int, stools: Seats = ()) -> Room:
    """Build a room.

    Args:
        kind: Name of the room, see KINDS.
        seed: Seed of colours, light, furniture, and the side of the windows.
        stools: Positions of stools [m], frame: map; their height is `furniture.SEAT_M`.
    """
    rng = np.random.default_rng([seed, KEY])
    if rng.random() < 0.5:
        return KINDS[kind](rng, stools)
    return _mirrored(KINDS[kind](rng, [(x, -y) for x, y in stools]))


def _lab(rng: np.random.Generator, stools: Seats) -> Room:
    low, high = (-0.6, -1.75, 0.0), (5.6, 1.75, 2.6)
    wall = _varied(rng, [(205, 201, 190), (190, 197, 201), (203, 205, 199), (207, 196, 180)])
    accent = _varied(rng, [(176, 188, 192), (172, 184, 168), (198, 190, 176), (188, 176, 170)])
    floor = _varied(rng, [(160, 118, 80), (136, 100, 70), (176, 144, 106), (120, 92, 70)])
    wood = _varied(rng, [(178, 142, 100), (122, 86, 58), (196, 176, 146), (96, 72, 54)])
    walls = np.array([wall, accent, wall, wall, floor, srgb(224, 224, 219)])
    warm = np.array([1.0, rng.uniform(0.9, 0.98), rng.uniform(0.72, 0.92)])
    sky = np.array([0.74, 0.86, 1.0]) * rng.uniform(0.6, 1.5)
    parts = _shell(low, high, walls, Material.PLANKS, rng) + furniture.skirting(low, high)
    parts += _office_furniture(rng, wood) + _stools(stools, wood)
    parts += furniture.window((2.3, 4.2), 1.75, (0.95, 2.15), _triple(sky * 2.2))
    for x in (1.3, 4.1):
        parts += furniture.ceiling_panel(x, 0.0, 2.6, _triple(warm * 4.5))
    lights = (
        Light(np.array([1.3, 0.0, 2.55]), DOWN, warm * 3.2, 0.3),
        Light(np.array([4.1, 0.0, 2.55]), DOWN, warm * 3.2, 0.3),
        Light(np.array([3.25, 1.64, 1.60]), INWARD, sky * 3.0, 0.5),
    )
    return Room(join(parts), lights, np.array(low), np.array(high), walls, rng.uniform(1.0, 1.35))


def _office_furniture(rng: np.random.Generator, wood: Vector) -> list[Mesh]:
    bin_colour = _varied(rng, [(62, 70, 82), (150, 60, 44), (70, 92, 70)])
    bin_finish = Finish(Material.METAL, bin_colour)
    return [
        *furniture.door(5.6, 1.12, wood),
        *furniture.poster(5.6, rng.uniform(-0.15, -0.05), (0.62, 0.84), int(rng.integers(1000))),
        *furniture.radiator((2.5, 4.0), 1.75),
        *furniture.shelf((5.28, -1.73, 0.0), (5.6, -0.95, 1.9), wood),
        *furniture.desk((4.98, -0.93), (5.58, 0.3), wood),
        *box((5.25, 0.45, 0.0), (5.49, 0.67, 0.36), bin_finish),
    ]


def _hall(rng: np.random.Generator, stools: Seats) -> Room:
    low, high = (-1.0, -4.0, 0.0), (9.0, 4.0, 3.4)
    wall = _varied(rng, [(186, 184, 178), (170, 172, 172), (196, 190, 176)])
    accent = _varied(rng, [(120, 128, 134), (136, 108, 92), (104, 122, 112), (158, 150, 138)])
    ground = Material.CONCRETE if rng.random() < 0.5 else Material.CARPET
    floor = _varied(rng, FLOORS[ground])
    wood = _varied(rng, [(150, 112, 74), (106, 78, 56), (184, 160, 126)])
    walls = np.array([wall, accent, wall, wall, floor, srgb(206, 204, 198)])
    warm = np.array([1.0, rng.uniform(0.78, 0.86), rng.uniform(0.5, 0.64)])
    sky = np.array([0.78, 0.88, 1.0]) * rng.uniform(0.7, 1.3)
    parts = _shell(low, high, walls, ground, rng) + furniture.skirting(low, high)
    parts += _foyer_furniture(rng, wall, wood) + _stools(stools, wood)
    for x in (0.2, 3.1, 6.0):
        parts += furniture.window((x, x + 2.4), 4.0, (0.5, 2.9), _triple(sky * 2.6))
    for x in (1.6, 4.4, 7.2):
        parts += furniture.pendant(x, 0.0, 2.6, 3.4, _triple(warm * 7.0))
    # Fewer lights than lamps and windows: each light costs time.
    lights = (
        Light(np.array([2.2, 0.0, 2.58]), DOWN, warm * 3.6, 0.3),
        Light(np.array([6.0, 0.0, 2.58]), DOWN, warm * 3.6, 0.3),
        Light(np.array([0.6, 3.88, 1.9]), INWARD, sky * 9.0, 0.8),
        Light(np.array([4.4, 3.88, 1.9]), INWARD, sky * 9.0, 0.8),
    )
    return Room(join(parts), lights, np.array(low), np.array(high), walls, rng.uniform(1.05, 1.35))


def _foyer_furniture(rng: np.random.Generator, wall: Vector, wood: Vector) -> list[Mesh]:
    parts = furniture.door(9.0, -2.4, wood) + furniture.door(9.0, -1.2, wood)
    for x in (2.2, 6.2):
        for y in (-2.9, 2.9):
            pillar = Finish(Material.CONCRETE, wall)
            parts += box((x - 0.2, y - 0.2, 0.0), (x + 0.2, y + 0.2, 3.4), pillar)
    for y in (0.1, 1.9):
        parts += furniture.poster(9.0, y, (1.1, 1.4), int(rng.integers(1000)))
    parts += furniture.shelf((8.68, -3.95, 0.0), (9.0, -3.05, 1.5), wood)
    parts += box((3.6, -3.96, 0.38), (5.6, -3.5, 0.45), Finish(Material.WOOD, wood))
    for x in (3.7, 5.4):
        parts += box((x, -3.9, 0.0), (x + 0.08, -3.56, 0.38), furniture.STEEL)
    return parts


def _stools(positions: Seats, wood: Vector) -> list[Mesh]:
    return [part for x, y in positions for part in furniture.stool(x, y, wood)]


def _office(rng: np.random.Generator, stools: Seats) -> Room:
    low, high = (-1.0, -3.2, 0.0), (7.4, 3.2, 2.45)
    wall = _varied(rng, [(214, 212, 206), (204, 206, 208), (208, 202, 190)])
    accent = _varied(rng, [(196, 200, 204), (186, 192, 190), (210, 206, 200)])
    ground = Material.CONCRETE if rng.random() < 0.6 else Material.CARPET
    pale = [(206, 202, 192), (190, 188, 182), (176, 174, 170)]
    floor = _varied(rng, pale if ground == Material.CONCRETE else FLOORS[ground])
    wood = _varied(rng, [(178, 142, 100), (122, 86, 58), (196, 176, 146)])
    walls = np.array([wall, accent, wall, wall, floor, srgb(226, 226, 222)])
    white = np.array([1.0, rng.uniform(0.92, 1.0), rng.uniform(0.84, 1.0)])
    sky = np.array([0.8, 0.9, 1.0]) * rng.uniform(1.0, 3.5)
    parts = _shell(low, high, walls, ground, rng) + furniture.skirting(low, high)
    for x in (0.4, 2.7, 5.0):
        parts += furniture.window((x, x + 2.0), 3.2, (0.9, 2.2), _triple(sky * 2.6))
    parts += furniture.radiator((1.0, 5.5), 3.2) + furniture.door(7.4, -1.8, wood)
    parts += furniture.shelf((7.08, 0.6, 0.0), (7.4, 2.6, 1.8), wood) + _stools(stools, wood)
    parts += furniture.poster(7.4, -0.6, (0.9, 0.7), int(rng.integers(1000)))
    lamps = [(x, y) for x in (1.0, 3.4, 5.8) for y in (-1.3, 1.3)]
    for x, y in lamps:
        parts += furniture.ceiling_panel(x, y, 2.45, _triple(white * 5.0))
    # Fewer lights than lamps, as in the hall
    lights = (
        Light(np.array([1.6, 0.0, 2.4]), DOWN, white * 3.4, 0.5),
        Light(np.array([5.0, 0.0, 2.4]), DOWN, white * 3.4, 0.5),
        Light(np.array([3.4, 3.1, 1.6]), INWARD, sky * 4.0, 0.9),
    )
    return Room(join(parts), lights, np.array(low), np.array(high), walls, rng.uniform(1.0, 1.5))


def _square(rng: np.random.Generator, stools: Seats) -> Room:
    low, high = (-12.6, -12.6, 0.0), (12.6, 12.6, 5.0)
    wall = _varied(rng, [(168, 164, 156), (150, 146, 140), (176, 168, 150)])
    accent = _varied(rng, [(140, 120, 104), (120, 128, 134), (158, 150, 138)])
    floor = _varied(rng, FLOORS[Material.CONCRETE])
    wood = _varied(rng, [(150, 112, 74), (106, 78, 56), (184, 160, 126)])
    walls = np.array([wall, accent, wall, wall, floor, srgb(206, 208, 210)])
    grey = np.array([0.96, 1.0, 1.0]) * rng.uniform(0.9, 1.1)
    parts = _shell(low, high, walls, Material.CONCRETE, rng) + _stools(stools, wood)
    lights = []
    for x in (-6.0, 2.0, 9.0):
        parts += furniture.ceiling_panel(x, 0.0, 5.0, _triple(grey * 5.0))
        lights.append(Light(np.array([x, 0.0, 4.9]), DOWN, grey * 14.0, 1.2))
    for y in (-8.0, -3.0, 3.0, 8.0):
        parts += furniture.door(12.6, y, wood)
        parts += furniture.poster(12.6, y + 1.2, (1.4, 1.8), int(rng.integers(1000)))
    exposure = rng.uniform(1.0, 1.4)
    return Room(join(parts), tuple(lights), np.array(low), np.array(high), walls, exposure)


KINDS: dict[str, Callable[[np.random.Generator, Seats], Room]] = {
    "lab": _lab,
    "hall": _hall,
    "office": _office,
    "square": _square,
}


def _shell(
    low: Vector, high: Vector, walls: F64, ground: Material, rng: np.random.Generator
) -> list[Mesh]:
    """Return floor, ceiling and four walls, seen from inside."""
    size = np.array(high) - np.array(low)
    x, y, z = np.diag(size)
    shift = _triple(np.append(rng.uniform(0, 20, 2), 0.0))
    finishes = [Finish(Material.PAINT, _triple(colour), shift) for colour in walls]
    corner = np.array(low)
    return [
        panel(corner, y, z, finishes[0]),
        panel(corner + x, z, y, finishes[1]),
        panel(corner, z, x, finishes[2]),
        panel(corner + y, x, z, finishes[3]),
        panel(corner, x, y, Finish(ground, _triple(walls[4]), shift)),
        panel(corner + z, y, x, finishes[5]),
    ]


def _varied(rng: np.random.Generator, palette: list[tuple[int, int, int]]) -> Vector:
    """Return one colour of a palette with a small change of brightness and tint."""
    colour = np.array(srgb(*palette[rng.integers(len(palette))]))
    return _triple(np.clip(colour * rng.normal(1.0, 0.08) * rng.normal(1.0, 0.025, 3), 0.01, 0.85))


def _triple(values: F64) -> Vector:
    return (float(values[0]), float(values[1]), float(values[2]))


def _mirrored(room: Room) -> Room:
    flip = np.array([1.0, -1.0, 1.0])
    mesh = replace(
        room.mesh,
        vertices_m=room.mesh.vertices_m * flip,
        normals=room.mesh.normals * flip,
        faces=np.ascontiguousarray(room.mesh.faces[:, ::-1]),
    )
    lights = tuple(
        replace(light, position_m=light.position_m * flip, towards=light.towards * flip)
        for light in room.lights
    )
    low, high = room.low_m * flip, room.high_m * flip
    walls = room.walls[[0, 1, 3, 2, 4, 5]]
    return replace(
        room,
        mesh=mesh,
        lights=lights,
        low_m=np.minimum(low, high),
        high_m=np.maximum(low, high),
        walls=walls,
    )
