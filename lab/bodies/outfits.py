"""Outfits: random clothes and hair for the people of the cast."""

from typing import Final, Literal, TypeVar

import numpy as np
from msgspec.structs import replace

from lab.bodies.cast import CastMember, Hair, Legwear, Shirt, Shoes

# own: as in the cast; dark: navy, black or dark grey from head to foot, hard to distinguish;
# random: any clothes, colours, hair and skin
Outfit = Literal["own", "dark", "random"]
T = TypeVar("T")

KEY = 111  # key of the random numbers
DARK_TOPS = ("#14161c", "#1a2030", "#1f1f21", "#26262a", "#231f24", "#1c2426", "#2a2a30")
DARK_LEGS = ("#1b2030", "#17171a", "#24262c", "#202a3c", "#2b2a2c")
DARK_HAIR = ("#14100e", "#1d1511", "#2a1d15", "#33261c")
# Muted colours are frequent: black, white, greys and blues
TOPS = (
    *DARK_TOPS,
    *("#d6d6d2", "#c4c6c8", "#8c8e92", "#5e6064", "#3c4654", "#2f4468", "#5f7fa6", "#a9b6c6"),
    *("#7c2430", "#9c2f36", "#b0622c", "#c9b04c", "#8a8250", "#4a6e4c", "#2f6468", "#27493a"),
    *("#5f4672", "#a8788c", "#c7a58c", "#8a6a50", "#5a4030", "#d8c8a4"),
)
LEGS = (
    *DARK_LEGS,
    *("#2b3a5c", "#39506f", "#46628c", "#6a7f9c", "#4a4b52", "#6a6c70", "#8d7d60", "#b09c7c"),
    *("#5a4836", "#3f4434", "#c9c4b8"),
)
HAIRS = (*DARK_HAIR, *DARK_HAIR, "#4a3020", "#5a3a1f", "#6a4626", "#8c6a3e", "#b08c5a", "#a3a09c")
SKINS = ("#e3b89d", "#dcb395", "#d9a888", "#d6a585", "#c08e6e", "#9a6a4c", "#7a5238", "#5c3a28")
SHOES = ("#2b2a2c", "#1c1c1e", "#3c2a20", "#5c3f28", "#c9c8c4", "#8a8a8c", "#7c2838", "#2c3c5c")
PATTERNS: Final = ("stripes", "plaid", "print", "placket", "blocks")
PLAIN = 0.6  # share of plain shirts
WOMEN = ("bea", "dana", "fumiko", "hana", "joy")  # figures with skirts and long hair
TINT = 0.12  # standard deviation of a colour channel's relative change


def dress_up(person: CastMember, outfit: Outfit, seed: int, number: int) -> CastMember:
    """Return a person of the cast in other clothes.

    Args:
        person: Person of the cast.
        outfit: Kind of clothes.
        seed: Seed of the scenario.
        number: Index of the person in the scenario, which random clothes depend on.
    """
    if outfit == "own":
        return person
    rng = np.random.default_rng([seed, KEY, number])
    return _dark(person, rng) if outfit == "dark" else _random(person, rng)


def _dark(person: CastMember, rng: np.random.Generator) -> CastMember:
    shoes = replace(person.shoes, colour=_tinted(rng, "#1c1c1e"), sole="#2a2a2a", socks="#202022")
    return replace(
        person,
        hair=replace(person.hair, colour=_tinted(rng, _one(rng, DARK_HAIR))),
        shirt=Shirt(
            colour=_tinted(rng, _one(rng, DARK_TOPS)),
            sleeves="long",
            loose_m=float(rng.uniform(0.008, 0.018)),
        ),
        legs=Legwear(
            colour=_tinted(rng, _one(rng, DARK_LEGS)), loose_m=float(rng.uniform(0.010, 0.020))
        ),
        shoes=shoes,
    )


def _random(person: CastMember, rng: np.random.Generator) -> CastMember:
    woman = person.figure in WOMEN
    bare = rng.random() < 0.1
    return replace(
        person,
        skin=_tinted(rng, _one(rng, SKINS), TINT / 3),
        glasses=bool(rng.random() < 0.25),
        hair=Hair(
            style=_hair_style(rng, woman),
            colour=_tinted(rng, _one(rng, HAIRS)),
            beard=not woman and bool(rng.random() < 0.35),
            thickness_m=float(rng.uniform(0.008, 0.03)),
        ),
        shirt=Shirt(
            colour=_tinted(rng, _one(rng, TOPS)),
            pattern="plain" if rng.random() < PLAIN else _one(rng, PATTERNS),
            sleeves="short" if rng.random() < 0.35 else "long",
            loose_m=float(rng.uniform(0.008, 0.02)),
        ),
        legs=Legwear(
            colour=_tinted(rng, _one(rng, LEGS)),
            kind=("skirt" if woman and rng.random() < 0.5 else "shorts") if bare else "trousers",
            loose_m=float(rng.uniform(0.010, 0.022)),
        ),
        shoes=Shoes(
            colour=_tinted(rng, _one(rng, SHOES)),
            sole=_one(rng, ("#b9b6ae", "#2a2624", "#e0e0dc")),
            socks=_one(rng, ("#4a4a4e", "#202022", "#c8c8c4")),
        ),
    )


def _hair_style(
    rng: np.random.Generator, woman: bool
) -> Literal["short", "long", "bob", "bun", "balding", "bald"]:
    if woman:
        return _one(rng, ("long", "bob", "bun", "short"))
    return _one(rng, ("short", "short", "short", "balding", "bald"))


def _one(rng: np.random.Generator, choices: tuple[T, ...]) -> T:
    return choices[int(rng.integers(len(choices)))]


def _tinted(rng: np.random.Generator, colour: str, sigma: float = TINT) -> str:
    """Return a colour with a small random change of brightness and tint."""
    channels = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    factors = 1 + sigma * (0.7 * rng.standard_normal() + 0.3 * rng.standard_normal(3))
    shifted = np.clip(np.array(channels) * factors, 4, 240).round().astype(int)
    return "#" + "".join(f"{channel:02x}" for channel in shifted)
