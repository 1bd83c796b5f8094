"""Bodies with random clothes: one mesh for each cut, with new colours for each identity."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import msgspec
import numpy as np

from lab.bodies.body import SkinnedBody, dress
from lab.bodies.cast import CastMember, cast_names, load_cast
from lab.bodies.figure import load_figure
from lab.bodies.skeleton import BodyPose
from lab.drawing.mesh import I32, Material, Mesh, Pattern
from people4d.messages import F32, F64

Rng = np.random.Generator
HAIR = ("short", "short", "short", "long", "bob", "bun", "balding", "bald")
LEGS = ("trousers", "trousers", "trousers", "trousers", "shorts", "skirt")
COLLAR_M = 1.5  # [m] height of the collar in the texture of a shirt
# Linear reflectance of common clothes
INDIGO, KHAKI = (0.05, 0.09, 0.2), (0.36, 0.28, 0.18)
SKINS = ((0.67, 0.42, 0.29), (0.72, 0.5, 0.38), (0.45, 0.25, 0.15), (0.2, 0.1, 0.06))
HAIRS = ((0.02, 0.015, 0.012), (0.06, 0.035, 0.02), (0.2, 0.12, 0.06), (0.35, 0.34, 0.33))
WHITE = (0.62, 0.61, 0.58)


@dataclass(frozen=True)
class Outfit:
    """Colours of one identity, linear, 0 to 1."""

    shirt: F64  # Bx3, bands from the collar down; one band: plain
    band_m: float  # [m] height of a band
    open_m: float  # [m] half width of a front strip in the last colour, 0: none
    pattern: Pattern
    legs: F64  # 3
    shoes: F64  # 3
    hair: F64  # 3
    skin: F64  # 3


class DressedBody:
    """A body in clothes of one cut.

    Args:
        member: Figure, hair and cut; colours do not matter.
    """

    def __init__(self, member: CastMember) -> None:
        figure = load_figure(member.figure)
        self.body = SkinnedBody(member.figure, figure, dress(figure, member, 0))

    def paint(self, outfit: Outfit, pose: BodyPose) -> "Paint":
        """Return the colours of an outfit on this body, independent of the pose."""
        mesh = self.body.mesh(pose, 0)
        colour = mesh.colour.copy()
        for material, own in (
            (Material.HAIR, outfit.hair),
            (Material.TROUSERS, outfit.legs),
            (Material.SHOE, outfit.shoes),
        ):
            colour[mesh.faces[mesh.material == material]] = own
        skin = np.unique(mesh.faces[mesh.material == Material.SKIN])
        colour[skin] *= (outfit.skin / np.median(colour[skin], axis=0)).astype(np.float32)
        shirt = mesh.material == Material.SHIRT
        cloth = np.unique(mesh.faces[shirt])
        colour[cloth] = shirt_colour(mesh.texture_m[cloth], outfit)
        pattern = np.where(shirt, np.int32(outfit.pattern), mesh.pattern)
        return Paint(np.clip(colour, 0, 1), pattern.astype(np.int32))

    def mesh(self, pose: BodyPose, owner: int, paint: "Paint") -> Mesh:
        """Return the body in a pose, on the floor."""
        mesh = self.body.mesh(pose, owner)
        np.maximum(mesh.vertices_m[:, 2], 0.0, out=mesh.vertices_m[:, 2])
        return replace(mesh, colour=paint.colour, pattern=paint.pattern)


@dataclass(frozen=True)
class Paint:
    """Colours of a dressed body."""

    colour: F32  # Vx3 linear reflectance
    pattern: I32  # F numbers of the cloth's pattern


def shirt_colour(texture_m: F32, outfit: Outfit) -> F64:
    """Return the colour of Vx3 points of a shirt, Vx3."""
    x, y, z = texture_m.T
    band = np.floor((COLLAR_M - z) / outfit.band_m).astype(int) % len(outfit.shirt)
    inside = (x > 0) & (np.abs(y) < outfit.open_m)
    return np.asarray(np.where(inside[:, None], outfit.shirt[-1], outfit.shirt[band]))


def draw_cut(rng: Rng) -> CastMember:
    """Draw a figure with hair and clothes of a random cut."""
    names = cast_names()
    base = load_cast()[names[rng.integers(len(names))]]
    sleeves: Literal["long", "short"] = "long" if rng.random() < 0.6 else "short"
    return msgspec.structs.replace(
        base,
        glasses=rng.random() < 0.3,
        hair=msgspec.structs.replace(
            base.hair,
            style=HAIR[rng.integers(len(HAIR))],
            beard=rng.random() < 0.25,
            thickness_m=rng.uniform(0.008, 0.03),
        ),
        shirt=msgspec.structs.replace(
            base.shirt, sleeves=sleeves, loose_m=rng.uniform(0.006, 0.022)
        ),
        legs=msgspec.structs.replace(
            base.legs, kind=LEGS[rng.integers(len(LEGS))], loose_m=rng.uniform(0.008, 0.024)
        ),
    )


def draw_outfit(rng: Rng, dark: bool = False) -> Outfit:
    """Draw the colours of a person; dark clothes have a realistic share.

    `dark`: black, dark grey or navy from head to foot.
    """
    if dark:
        return Outfit(
            shirt=np.array([dark_cloth(rng)]),
            band_m=1.0,
            open_m=0.0,
            pattern=Pattern(0),
            legs=dark_cloth(rng),
            shoes=grey(rng, 0.008, 0.03),
            hair=varied(rng, HAIRS[rng.integers(len(HAIRS))], 0.4),
            skin=varied(rng, SKINS[rng.integers(len(SKINS))], 0.2),
        )
    count = 1 if rng.random() < 0.72 else int(rng.integers(2, 4))
    patterns: Sequence[Pattern] = (
        list(Pattern) if count == 1 and rng.random() < 0.4 else [Pattern(0)]
    )
    return Outfit(
        shirt=np.array([shirt_cloth(rng) for _ in range(count)]),
        band_m=rng.uniform(0.03, 0.16) if rng.random() < 0.7 else rng.uniform(0.2, 0.5),
        open_m=rng.uniform(0.03, 0.1) if rng.random() < 0.2 else 0.0,
        pattern=patterns[int(rng.integers(len(patterns)))],
        legs=leg_cloth(rng),
        shoes=any_colour(rng) if rng.random() < 0.3 else grey(rng, 0.01, 0.5),
        hair=varied(rng, HAIRS[rng.integers(len(HAIRS))], 0.4),
        skin=varied(rng, SKINS[rng.integers(len(SKINS))], 0.2),
    )


def dark_cloth(rng: Rng) -> F64:
    """Draw a dark colour, sometimes bluish."""
    blue = np.array([1.0, 1.0, rng.uniform(1.0, 2.2)])
    return varied(rng, grey(rng, 0.006, 0.035) * blue, 0.15)


def shirt_cloth(rng: Rng) -> F64:
    """Draw the colour of a shirt."""
    kind = rng.random()
    if kind < 0.25:
        return grey(rng, 0.008, 0.06)
    if kind < 0.4:
        return varied(rng, WHITE, 0.25)
    if kind < 0.5:
        return varied(rng, INDIGO, 0.7)
    if kind < 0.6:
        return grey(rng, 0.05, 0.5)
    return any_colour(rng)


def leg_cloth(rng: Rng) -> F64:
    """Draw the colour of trousers."""
    kind = rng.random()
    if kind < 0.35:
        return grey(rng, 0.008, 0.08)
    if kind < 0.65:
        return varied(rng, INDIGO, 0.3) * rng.uniform(0.3, 3.0)
    if kind < 0.8:
        return varied(rng, KHAKI, 0.3)
    return any_colour(rng)


def any_colour(rng: Rng) -> F64:
    """Draw a colour of any hue, dark ones more often."""
    hsv = np.array([[[rng.uniform(0, 360), rng.uniform(0.15, 0.95), rng.uniform(0.2, 0.95)]]])
    encoded = cv2.cvtColor(hsv.astype(np.float32), cv2.COLOR_HSV2RGB)[0, 0]
    return np.asarray(encoded.astype(np.float64) ** 2.2)


def grey(rng: Rng, low: float, high: float) -> F64:
    """Draw a grey, with a slight tint."""
    return varied(rng, np.exp(rng.uniform(np.log(low), np.log(high))) * np.ones(3), 0.12)


def varied(rng: Rng, colour: Sequence[float] | F64, share: float) -> F64:
    """Return a colour with random brightness (a share) and tint (a third of the share)."""
    gain = np.exp(rng.normal(0, share) + rng.normal(0, share / 3, 3))
    return np.asarray(np.clip(np.asarray(colour) * gain, 0.004, 0.85))
