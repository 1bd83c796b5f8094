"""Clothes, cut from the helper meshes of bodies."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

from lab.bodies.cast import CastMember, Legwear, Shirt, Shoes, linear
from lab.bodies.figure import Figure
from lab.bodies.skinning import normals
from lab.bodies.surface import BodySurface, border, cut, smoothed, walls
from lab.drawing.mesh import Material, Pattern
from people4d.messages import F64

BREAK_M = 0.05  # overlap of trousers over the ankle [m]
SOCK_M = 0.03  # height of socks above the shoe [m]
SOLE_M = 0.018  # thickness of a sole below the bare foot [m]
WELT_M = 0.006  # height of a sole's upper edge above the bare sole [m]
SECTORS = 36  # number of sectors of hanging cloth
ROW_M = 0.015  # height of a row of hanging cloth [m]
FALL = 0.22  # slope of hanging cloth towards the body


@dataclass(frozen=True)
class HemLevels:
    """Heights of the ends of clothes [m], pelvis frame."""

    collar: float  # neckline at the back
    sleeve: float  # end of the sleeves of hanging arms
    hem: float  # lower end of the shirt
    waist: float  # upper end of the legwear
    legs: float  # lower end of the legwear
    shoe: float  # upper end of the shoes
    floor: float  # level of the bare soles
    tucked: bool  # True: the shirt is inside the legwear


def measure(figure: Figure, person: CastMember) -> HemLevels:
    """Return the heights of the ends of a person's clothes."""
    joints = figure.joints_m
    (hip, knee, ankle, shoulder, elbow, wrist) = (
        float(joints[name][0, 2]) for name in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
    )
    skirt = person.legs.kind == "skirt"
    leg_ends = {"trousers": ankle + 0.025, "shorts": knee + 0.05, "skirt": knee + 0.02}
    # A shirt hangs over trousers and is tucked into a skirt.
    waist = float(joints["waist"][2]) - 0.01 if skirt else hip + 0.02
    return HemLevels(
        collar=float(joints["neck"][2]) + 0.012,
        sleeve=wrist + 0.005
        if person.shirt.sleeves == "long"
        else elbow + 0.25 * (shoulder - elbow),
        hem=waist - 0.05 if skirt else hip - 0.03,
        waist=waist,
        legs=leg_ends[person.legs.kind],
        shoe=ankle + 0.005,
        floor=float(figure.vertices_m[np.unique(figure.faces["tights"])][:, 2].min()),
        tucked=skirt,
    )


def arm_share(figure: Figure, weights: F64) -> F64:
    """Return the membership of vertices with these weights in an arm, 0 to 1."""
    kinds = ("upper_arm", "elbow", "forearm")
    columns = [index for index, name in enumerate(figure.bones) if name.startswith(kinds)]
    return np.asarray(weights[:, columns].sum(axis=1))


def on_arm(figure: Figure) -> npt.NDArray[np.bool_]:
    """Return the mask of vertices that belong to an arm."""
    return np.asarray(arm_share(figure, figure.weights) > 0.5)


def collar_field(figure: Figure, collar: float) -> F64:
    """Return the distance of vertices below a neckline that is lower in front [m]."""
    x, _, z = figure.vertices_m.T
    return np.asarray(collar - 0.45 * (x - figure.joints_m["neck"][0]) - z)


def cloth(figure: Figure, part: str, colour: str, material: Material) -> BodySurface:
    """Return a part of a figure, such as a helper mesh, in one colour and material."""
    return BodySurface(
        vertices_m=figure.vertices_m,
        weights=figure.weights,
        colour=np.tile(linear(colour), (len(figure.vertices_m), 1)),
        faces=figure.faces[part],
        material=material,
    )


def loosened(piece: BodySurface, distance_m: F64, rounds: int) -> BodySurface:
    """Return a smooth garment at given distances (V) from a close-fitting one."""
    outward = normals(piece.vertices_m, piece.faces)
    loose = smoothed(piece.moved(outward * distance_m[:, None]), rounds)
    return no_closer(loose, piece, 0.7 * distance_m)


def no_closer(loose: BodySurface, piece: BodySurface, distance_m: F64) -> BodySurface:
    """Move a loose garment outwards to minimum distances (V) from a close-fitting one."""
    outward = normals(piece.vertices_m, piece.faces)
    gap = np.einsum("vi,vi->v", loose.vertices_m - piece.vertices_m, outward)
    positions = loose.vertices_m + outward * np.maximum(distance_m - gap, 0.0)[:, None]
    # The heights of hems do not change.
    rim = np.unique(border(piece.faces))
    positions[rim, 2] = piece.vertices_m[rim, 2]
    return replace(loose, vertices_m=positions)


def make_shirt(figure: Figure, shirt: Shirt, levels: HemLevels) -> BodySurface:
    """Return the shirt."""
    z = figure.vertices_m[:, 2]
    torso = np.minimum(z - levels.hem, collar_field(figure, levels.collar))
    sheet = cloth(figure, "tights", shirt.colour, Material.SHIRT)
    piece = cut(sheet, np.where(on_arm(figure), z - levels.sleeve, torso))
    height = piece.vertices_m[:, 2]
    below = np.clip((levels.collar - 0.05 - height) / 0.3, 0, 1)
    # Sleeves are narrower than the torso.
    distance = 0.004 + shirt.loose_m * below * (1 - 0.7 * arm_share(figure, piece.weights))
    if levels.tucked:
        distance *= np.clip((height - levels.waist) / 0.08, 0.1, 1)
    loose = loosened(piece, distance, 4)
    if not levels.tucked:
        armpit = figure.joints_m["shoulder"][0, 2] - 0.13
        free = np.clip((armpit - height) / 0.06, 0, 1) * (arm_share(figure, piece.weights) < 0.3)
        hanging = smoothed(hung(loose, figure.joints_m["waist"][0], free), 2)
        loose = no_closer(hanging, piece, 0.8 * distance)
    return replace(loose, pattern=Pattern[shirt.pattern.upper()])


def make_legwear(figure: Figure, legs: Legwear, levels: HemLevels) -> BodySurface:
    """Return trousers, shorts or a skirt."""
    z = figure.vertices_m[:, 2]
    part = "skirt" if legs.kind == "skirt" else "tights"
    field = np.minimum(levels.waist - z, z - levels.legs)
    sheet = cloth(figure, part, legs.colour, Material.TROUSERS)
    piece = cut(sheet, np.where(on_arm(figure), -1.0, field))
    below = np.clip((levels.waist - piece.vertices_m[:, 2]) / 0.7, 0, 1)
    least = 0.009 if levels.tucked else 0.001
    loose = loosened(piece, least + legs.loose_m * below, 4)
    return lengthened(loose, levels.legs, BREAK_M) if legs.kind == "trousers" else loose


def lengthened(piece: BodySurface, end_m: float, by_m: float) -> BodySurface:
    """Return trousers with their lower hem, at a height, extended down over the shoe."""
    edges = border(piece.faces)
    low = piece.vertices_m[edges, 2] < end_m + 0.03
    count = len(piece.vertices_m)
    return BodySurface(
        vertices_m=np.concatenate([piece.vertices_m, piece.vertices_m - (0.0, 0.0, by_m)]),
        weights=np.tile(piece.weights, (2, 1)),
        colour=np.tile(piece.colour, (2, 1)),
        faces=np.concatenate([piece.faces, walls(edges[low.all(axis=1)], count)]),
        material=piece.material,
    ).compact()


def make_socks(figure: Figure, shoes: Shoes, levels: HemLevels) -> BodySurface:
    """Return short socks."""
    z = figure.vertices_m[:, 2]
    sheet = cloth(figure, "tights", shoes.socks, Material.TROUSERS)
    field = np.minimum(levels.shoe + SOCK_M - z, z - levels.floor - 0.02)
    return cut(sheet, field).inflated(0.0015)


def make_shoes(figure: Figure, shoes: Shoes, levels: HemLevels) -> list[BodySurface]:
    """Return the uppers of both shoes, and their flat soles."""
    z = figure.vertices_m[:, 2]
    foot = cut(cloth(figure, "tights", shoes.colour, Material.SHOE), levels.shoe - z)
    deep = np.clip((levels.shoe - foot.vertices_m[:, 2]) / 0.03, 0, 1)
    shoe = foot.inflated(0.003 + 0.005 * deep)
    height = shoe.vertices_m[:, 2] - levels.floor
    upper = cut(shoe, height - WELT_M)
    sole = cut(shoe, WELT_M + 1e-9 - height)
    return [upper, slab(sole, levels.floor - SOLE_M, linear(shoes.sole))]


def slab(piece: BodySurface, bottom_m: float, colour: F64) -> BodySurface:
    """Return a piece flattened at a height, with vertical walls at its border."""
    count = len(piece.vertices_m)
    flat = piece.vertices_m.copy()
    flat[:, 2] = bottom_m
    return BodySurface(
        vertices_m=np.concatenate([piece.vertices_m, flat]),
        weights=np.tile(piece.weights, (2, 1)),
        colour=np.tile(colour, (2 * count, 1)),
        faces=np.concatenate([piece.faces + np.int32(count), walls(border(piece.faces), count)]),
        material=Material.SHOE,
    ).compact()


def hung(piece: BodySurface, axis_x_m: float, free: F64) -> BodySurface:
    """Return cloth around the torso that bridges hollows.

    Args:
        piece: Close-fitting cloth.
        axis_x_m: Position of the torso's vertical axis.
        free: V, 0 for fixed cloth, 1 for hanging cloth.
    """
    x, y, z = piece.vertices_m.T
    around = np.arctan2(y, x - axis_x_m) / (2 * np.pi) * SECTORS % SECTORS
    radius = np.hypot(x - axis_x_m, y)
    top = z[free > 0].max()
    row = (top - z) / ROW_M
    outline = hanging_outline(around[free > 0], row[free > 0], radius[free > 0])
    wanted = map_coordinates(outline, [row, around], order=1, mode="grid-wrap")
    grown = 1 + free * np.maximum(wanted - radius, 0.0) / np.maximum(radius, 1e-3)
    positions = np.stack([axis_x_m + (x - axis_x_m) * grown, y * grown, z], axis=1)
    return replace(piece, vertices_m=positions)


def hanging_outline(around: F64, row: F64, radius: F64) -> F64:
    """Return the radius of hanging cloth by row, from the top, and sector.

    Args:
        around: V positions in sectors, 0 to SECTORS.
        row: V positions in rows.
        radius: V distances of the close-fitting cloth from the axis [m].
    """
    rows = int(row.max()) + 2
    outline = np.zeros((rows, SECTORS))
    positions = (
        np.clip(np.rint(row), 0, rows - 1).astype(int),
        np.rint(around).astype(int) % SECTORS,
    )
    np.maximum.at(outline, positions, radius)
    # Cloth is taut between its neighbours on both sides
    beside = (np.roll(outline, 1, axis=1) + np.roll(outline, -1, axis=1)) / 2
    outline = np.maximum(outline, beside)
    for below in range(1, rows):
        outline[below] = np.maximum(outline[below], outline[below - 1] - FALL * ROW_M)
    return outline
