"""The cast: people and their clothes; data in assets/cast.toml."""

import tomllib
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from people4d.messages import F64

CAST = Path(__file__).parents[1] / "assets" / "cast.toml"

Colour = Annotated[str, Meta(pattern="^#[0-9a-f]{6}$")]


class Hair(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Hair of head and face."""

    style: Literal["short", "long", "bob", "bun", "balding", "bald"] = "short"
    colour: Colour = "#2e2019"
    beard: bool = False
    thickness_m: float = 0.016  # thickness on the crown


class Shirt(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Clothes of the upper body."""

    colour: Colour
    pattern: Literal["plain", "stripes", "plaid", "print", "placket", "blocks"] = "plain"
    sleeves: Literal["short", "long"] = "short"
    loose_m: float = 0.012  # distance of cloth from the close-fitting suit


class Legwear(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Clothes of the legs."""

    colour: Colour
    kind: Literal["trousers", "shorts", "skirt"] = "trousers"
    loose_m: float = 0.014  # distance of cloth from the close-fitting suit at the hem


class Shoes(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Shoes and socks."""

    colour: Colour = "#2b2a2c"
    sole: Colour = "#b9b6ae"
    socks: Colour = "#4a4a4e"


class CastMember(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Person of the cast."""

    about: str  # description in a few words
    figure: str  # name of the baked body
    age_years: int | None = None  # age of a child; None: an adult or a teenager
    skin: Colour
    eyes: Colour = "#4a3524"
    glasses: bool = False
    hair: Hair
    shirt: Shirt
    legs: Legwear
    shoes: Shoes = Shoes()


@cache
def load_cast() -> dict[str, CastMember]:
    """Return all people of the cast by name."""
    data = tomllib.loads(CAST.read_text(encoding="utf-8"))
    return msgspec.convert(data, dict[str, CastMember])


def cast_names() -> list[str]:
    """Return the names of the cast without young children, from which random scenes draw."""
    return [name for name, person in load_cast().items() if person.age_years is None]


def child_names() -> list[str]:
    """Return the names of the young children of the cast."""
    return [name for name, person in load_cast().items() if person.age_years is not None]


def linear(colour: str) -> F64:
    """Return red, green, blue, 0 to 1, of #rrggbb (IEC 61966-2-1)."""
    encoded = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    decoded: F64 = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return decoded
