"""Clothes, cut from the helper meshes that follow every body."""

import numpy as np

from common.messages import F64
from services.camera.lab.cast import Legwear, Person, Shirt, Shoes
from services.camera.lab.colours import linear
from services.camera.lab.figure import Figure
from services.camera.lab.materials import Material, Pattern
from services.camera.lab.surface import Surface, cut, smoothed

SOLE_M = 0.012  # [m] of the sole, below the bare foot
SKIN_UNDER_M = 0.04  # [m] that skin goes on under a hem


class Levels:
    """Heights at which clothes end, pelvis frame, in metres.

    Args:
        figure: Who wears them.
        person: What they wear.
    """

    def __init__(self, figure: Figure, person: Person) -> None:
        joints = figure.joints_m
        elbow, wrist = joints["elbow"][0, 2], joints["wrist"][0, 2]
        knee, ankle = joints["knee"][0, 2], joints["ankle"][0, 2]
        upper_arm_m = joints["shoulder"][0, 2] - elbow
        self.neck = joints["neck"][2]
        self.sleeve = wrist if person.shirt.sleeves == "long" else elbow + 0.22 * upper_arm_m
        self.hem = joints["hip"][0, 2] - 0.02
        self.waist = joints["waist"][2]
        self.floor = figure.vertices_m[np.unique(figure.faces["tights"])][:, 2].min()
        self.shoe = ankle + 0.005
        hems = {
            "trousers": ankle - 0.025,
            "shorts": knee + 0.05,
            "skirt": knee,
        }
        self.legs = hems[person.legs.kind]


def arm_shares(figure: Figure) -> F64:
    """Return how far each vertex belongs to an arm, 0 to 1."""
    return shares(figure, ("upper_arm", "elbow", "forearm"))


def shares(figure: Figure, kinds: tuple[str, ...]) -> F64:
    """Return how far each vertex belongs to bones whose names begin so, 0 to 1."""
    columns = [index for index, name in enumerate(figure.bones) if name.startswith(kinds)]
    total: F64 = figure.weights[:, columns].sum(axis=1)
    return total


def cloth(figure: Figure, part: str, colour: str, material: Material) -> Surface:
    """Return a whole helper mesh as plain cloth."""
    vertices = figure.vertices_m
    return Surface(
        vertices_m=vertices,
        weights=figure.weights,
        colour=np.tile(linear(colour), (len(vertices), 1)),
        faces=figure.faces[part],
        material=material,
    )


def make_shirt(figure: Figure, shirt: Shirt, levels: Levels) -> Surface:
    """Return the shirt."""
    x, _, z = figure.vertices_m.T
    # The collar lies lower in front than behind.
    collar = levels.neck + 0.012 - 0.45 * (x - figure.joints_m["neck"][0])
    trunk = np.minimum(z - levels.hem, collar - z)
    is_arm = arm_shares(figure) > 0.5
    whole = cloth(figure, "tights", shirt.colour, Material.SHIRT)
    piece = cut(whole, np.where(is_arm, z - levels.sleeve, trunk))
    return drape(piece, figure, shirt.loose_m, levels.neck)


def drape(piece: Surface, figure: Figure, loose_m: float, neck: float) -> Surface:
    """Return cloth that is wider the further it hangs below the neck."""
    below = np.clip((neck - piece.vertices_m[:, 2]) / 0.45, 0, 1)
    return smoothed(piece.inflated(0.004 + loose_m * below), 4)


def make_legwear(figure: Figure, legs: Legwear, levels: Levels) -> Surface:
    """Return trousers, shorts or a skirt."""
    z = figure.vertices_m[:, 2]
    part = "skirt" if legs.kind == "skirt" else "tights"
    whole = cloth(figure, part, legs.colour, Material.TROUSERS)
    field = np.minimum(levels.waist - z, z - levels.legs)
    piece = cut(whole, np.where(arm_shares(figure) > 0.5, -1.0, field))
    below = np.clip(-piece.vertices_m[:, 2] / 0.8, 0, 1)
    return smoothed(piece.inflated(0.004 + legs.loose_m * below), 4)


def make_shoes(figure: Figure, shoes: Shoes, levels: Levels) -> Surface:
    """Return both shoes, with flat soles."""
    z = figure.vertices_m[:, 2]
    whole = cloth(figure, "tights", shoes.colour, Material.SHOE)
    piece = smoothed(cut(whole, levels.shoe - z).inflated(0.010), 2)
    height = piece.vertices_m[:, 2] - levels.floor
    lifted = np.where(height < 0.015, -SOLE_M, height)
    colour = np.where((height < 0.018)[:, None], linear(shoes.sole), piece.colour)
    return Surface(
        vertices_m=np.c_[piece.vertices_m[:, :2], lifted + levels.floor],
        weights=piece.weights,
        colour=colour,
        faces=piece.faces,
        material=Material.SHOE,
        pattern=Pattern.PLAIN,
    )
