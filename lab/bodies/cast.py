"""The cast: who can be in a scenario, and what they wear; data in assets/cast.toml."""

import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Literal

import msgspec

CAST = Path(__file__).parents[1] / "assets" / "cast.toml"
COLOUR = re.compile(r"#[0-9a-f]{6}")


class Hair(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Hair of head and face."""

    style: Literal["short", "long", "bob", "bun", "balding", "bald"] = "short"
    colour: str = "#2e2019"
    beard: bool = False
    thickness_m: float = 0.016  # [m] on the crown


class Shirt(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the upper body wears."""

    colour: str
    pattern: Literal["plain", "stripes", "plaid", "print", "placket", "blocks"] = "plain"
    sleeves: Literal["short", "long"] = "short"
    loose_m: float = 0.012  # [m] of cloth outside the close-fitting suit


class Legwear(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the legs wear."""

    colour: str
    kind: Literal["trousers", "shorts", "skirt"] = "trousers"
    loose_m: float = 0.014  # [m] of cloth outside the close-fitting suit, at the hem


class Shoes(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the feet wear."""

    colour: str = "#2b2a2c"
    sole: str = "#b9b6ae"
    socks: str = "#4a4a4e"


class Person(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One of the cast."""

    about: str  # a few words
    figure: str  # name of the baked body
    skin: str
    eyes: str = "#4a3524"
    glasses: bool = False
    hair: Hair
    shirt: Shirt
    legs: Legwear
    shoes: Shoes = Shoes()

    def __post_init__(self) -> None:
        """Check colours.

        Raises:
            ValueError: One is not #rrggbb.
        """
        parts = (self.hair, self.shirt, self.legs, self.shoes)
        for colour in (
            self.skin,
            self.eyes,
            self.shoes.sole,
            self.shoes.socks,
            *(part.colour for part in parts),
        ):
            if not COLOUR.fullmatch(colour):
                raise ValueError(f"colour: expected #rrggbb, got {colour}")


@cache
def load_cast() -> dict[str, Person]:
    """Return all people by name."""
    data = tomllib.loads(CAST.read_text(encoding="utf-8"))
    return msgspec.convert(data, dict[str, Person])


def cast_names() -> list[str]:
    """Return the names that a scenario can give as `body`."""
    return list(load_cast())
