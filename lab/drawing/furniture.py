"""Furniture of rooms."""

from collections.abc import Sequence

import numpy as np

from lab.drawing.mesh import Material, Mesh
from lab.drawing.solids import Finish, box, cylinder, panel, pictured, shaded, srgb

Vector = tuple[float, float, float]

SEAT_M = 0.45  # height of a stool
WHITE = Finish(Material.METAL, srgb(228, 228, 222))
STEEL = Finish(Material.METAL, srgb(96, 98, 102))
BLACK = Finish(Material.FABRIC, srgb(24, 24, 27))


def stool(x_m: float, y_m: float, colour: Vector) -> list[Mesh]:
    """Return a round stool with four legs."""
    parts = cylinder((x_m, y_m, SEAT_M - 0.05), 0.18, 0.05, Finish(Material.WOOD, colour))
    for dx in (-0.11, 0.11):
        for dy in (-0.11, 0.11):
            parts += cylinder((x_m + dx, y_m + dy, 0.0), 0.014, SEAT_M - 0.05, STEEL)
    return parts


def door(x_m: float, y_m: float, colour: Vector) -> list[Mesh]:
    """Return a closed door in a wall that faces -x; y_m is its middle."""
    leaf = Finish(Material.WOOD, colour, (3.1, 0.4, 0.0))
    low, high = y_m - 0.43, y_m + 0.43
    parts = box((x_m - 0.03, low, 0.0), (x_m, high, 2.05), leaf)
    for side in (low - 0.08, high):
        parts += box((x_m - 0.05, side, 0.0), (x_m, side + 0.08, 2.13), WHITE)
    parts += box((x_m - 0.05, low, 2.05), (x_m, high, 2.13), WHITE)
    parts += box((x_m - 0.075, low + 0.07, 1.00), (x_m - 0.055, low + 0.19, 1.02), STEEL)
    return parts + box((x_m - 0.06, low + 0.06, 0.92), (x_m - 0.03, low + 0.10, 1.10), STEEL)


def poster(x_m: float, y_m: float, size_m: tuple[float, float], number: int) -> list[Mesh]:
    """Return a framed image on a wall that faces -x; y_m is its right edge in the view from -x."""
    width, height = size_m
    low = 1.15
    frame = box(
        (x_m - 0.018, y_m - 0.02, low - 0.02), (x_m, y_m + width + 0.02, low + height + 0.02), BLACK
    )
    finish = Finish(Material.POSTER, srgb(220, 220, 215))
    sheet = panel((x_m - 0.019, y_m + width, low), (0, -width, 0), (0, 0, height), finish)
    return [*frame, pictured(sheet, 1, 1, number)]


def window(
    x_m: tuple[float, float], y_m: float, z_m: tuple[float, float], sky: Vector
) -> list[Mesh]:
    """Return a window in the wall y = y_m, which faces -y, with the sky behind it."""
    (left, right), (low, high) = x_m, z_m
    middle = low + 0.38 * (high - low)
    bright, hazy, ground = np.array(sky), np.array(sky) * 0.8, np.array(sky) * (0.16, 0.2, 0.12)
    glass = Finish(Material.LAMP, sky)
    upper = panel((left, y_m - 0.004, middle), (right - left, 0, 0), (0, 0, high - middle), glass)
    lower = panel((left, y_m - 0.004, low), (right - left, 0, 0), (0, 0, middle - low), glass)
    parts = [
        shaded(upper, [hazy, hazy, bright, bright]),
        shaded(lower, [ground, ground, hazy * 0.45, hazy * 0.45]),
    ]
    panes = max(1, round((right - left) / 0.9))
    for bar in np.linspace(left, right, panes + 1):
        parts += box((bar - 0.03, y_m - 0.06, low), (bar + 0.03, y_m, high), WHITE)
    parts += box((left - 0.05, y_m - 0.14, low - 0.05), (right + 0.05, y_m, low), WHITE)
    return parts + box((left - 0.03, y_m - 0.06, high), (right + 0.03, y_m, high + 0.06), WHITE)


def shelf(low_m: Vector, high_m: Vector, colour: Vector) -> list[Mesh]:
    """Return a shelf full of books against the wall x = high_m[0], open towards -x."""
    (x0, y0, z0), (x1, y1, z1) = low_m, high_m
    wood = Finish(Material.WOOD, colour, (0.0, 1.7, 0.3))
    parts = box((x0, y0, z0), (x1, y0 + 0.025, z1), wood) + box(
        (x0, y1 - 0.025, z0), (x1, y1, z1), wood
    )
    parts += box((x1 - 0.02, y0, z0), (x1, y1, z1), wood)
    count = max(1, round((z1 - z0) / 0.36))
    for level in np.linspace(z0, z1 - 0.025, count + 1):
        parts += box((x0, y0, level), (x1, y1, level + 0.025), wood)
    spines = panel(
        (x0 + 0.04, y1 - 0.025, z0),
        (0, y0 - y1 + 0.05, 0),
        (0, 0, z1 - z0),
        Finish(Material.BOOKS, (1, 1, 1)),
    )
    return [*parts, pictured(spines, y1 - y0, count)]


def desk(low_m: tuple[float, float], high_m: tuple[float, float], colour: Vector) -> list[Mesh]:
    """Return a desk with a screen that faces -x, papers and a cup."""
    (x0, y0), (x1, y1) = low_m, high_m
    parts = box((x0, y0, 0.70), (x1, y1, 0.735), Finish(Material.WOOD, colour, (0.2, 5.0, 0.0)))
    for x in (x0 + 0.03, x1 - 0.07):
        for y in (y0 + 0.03, y1 - 0.07):
            parts += box((x, y, 0.0), (x + 0.04, y + 0.04, 0.70), STEEL)
    middle = y0 + 0.6 * (y1 - y0)
    parts += box((x1 - 0.26, middle - 0.27, 0.83), (x1 - 0.23, middle + 0.27, 1.15), BLACK)
    parts += box((x1 - 0.25, middle - 0.03, 0.735), (x1 - 0.22, middle + 0.03, 0.85), BLACK)
    paper = Finish(Material.FABRIC, srgb(232, 230, 224))
    parts += box((x0 + 0.10, y0 + 0.10, 0.735), (x0 + 0.40, y0 + 0.31, 0.75), paper)
    return parts + cylinder(
        (x0 + 0.15, y1 - 0.2, 0.735), 0.04, 0.09, Finish(Material.SHOE, srgb(150, 44, 36))
    )


def radiator(x_m: tuple[float, float], y_m: float) -> list[Mesh]:
    """Return a ribbed radiator in front of the wall y = y_m, which faces -y."""
    parts = box((x_m[0], y_m - 0.07, 0.14), (x_m[1], y_m - 0.03, 0.66), WHITE)
    for x in np.arange(x_m[0], x_m[1], 0.075):
        parts += box((x, y_m - 0.10, 0.12), (x + 0.045, y_m - 0.07, 0.68), WHITE)
    return parts


def pendant(x_m: float, y_m: float, z_m: float, ceiling_m: float, glow: Vector) -> list[Mesh]:
    """Return a pendant lamp; z_m is its lower edge."""
    shade = cylinder((x_m, y_m, z_m + 0.01), 0.22, 0.16, Finish(Material.METAL, srgb(52, 54, 58)))
    bulb = cylinder((x_m, y_m, z_m), 0.2, 0.01, Finish(Material.LAMP, glow))
    cord = box((x_m - 0.006, y_m - 0.006, z_m + 0.17), (x_m + 0.006, y_m + 0.006, ceiling_m), BLACK)
    return [*shade, *bulb, *cord]


def ceiling_panel(x_m: float, y_m: float, ceiling_m: float, glow: Vector) -> list[Mesh]:
    """Return a square lamp in the ceiling."""
    parts = box(
        (x_m - 0.32, y_m - 0.32, ceiling_m - 0.025), (x_m + 0.32, y_m + 0.32, ceiling_m), WHITE
    )
    low = (x_m - 0.29, y_m + 0.29, ceiling_m - 0.027)
    return [*parts, panel(low, (0.58, 0, 0), (0, -0.58, 0), Finish(Material.LAMP, glow))]


def skirting(low_m: Vector, high_m: Vector) -> list[Mesh]:
    """Return the boards along the foot of the four walls of a room."""
    (x0, y0, _), (x1, y1, _) = low_m, high_m
    corners: Sequence[tuple[Vector, Vector]] = (
        ((x1 - 0.015, y0, 0.0), (x1, y1, 0.08)),
        ((x0, y0, 0.0), (x1, y0 + 0.015, 0.08)),
        ((x0, y1 - 0.015, 0.0), (x1, y1, 0.08)),
        ((x0, y0, 0.0), (x0 + 0.015, y1, 0.08)),
    )
    return [side for low, high in corners for side in box(low, high, WHITE)]
