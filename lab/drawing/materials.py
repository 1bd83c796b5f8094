"""What surfaces are made of: one number for each solid texture that the shading knows."""

from enum import IntEnum


class Material(IntEnum):
    """Kinds of surface."""

    SKIN = 0
    HAIR = 1
    SHIRT = 2
    TROUSERS = 3
    SHOE = 4
    EYE = 5
    PLANKS = 10
    PAINT = 11
    WOOD = 12
    POSTER = 13
    LAMP = 14
    BOOKS = 15
    FABRIC = 16
    CARPET = 17
    CONCRETE = 18
    METAL = 19


class Pattern(IntEnum):
    """Patterns of a shirt."""

    PLAIN = 0
    STRIPES = 1
    PLAID = 2
    PRINT = 3
    PLACKET = 4  # a row of buttons and fine vertical lines
    BLOCKS = 5  # chest and belly of different brightness
