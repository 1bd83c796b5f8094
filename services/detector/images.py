"""Windows of colour and depth around people as input of networks."""

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeVar, cast

import cv2

from people4d.messages import U8, U16

SIDE_MIN_PX = 4  # minimum side of a window [px]

Image = TypeVar("Image", U8, U16)


class Window(NamedTuple):
    """Part of a window inside an image, and the rest around it."""

    inside: tuple[slice, slice]  # rows and columns of the image
    edges: tuple[int, int, int, int]  # [px] above, below, left and right of the image


def cut_window(sides_px: Sequence[float], width: int, height: int) -> Window | None:
    """Return the window of an image of a width and height in pixels; None if it is outside.

    The sides are left, top, right and bottom; distant ones are cut at the image's size.
    """
    left, top, right, bottom = (
        round(min(max(side, -limit), 2 * limit)) if math.isfinite(side) else -limit
        for side, limit in zip(sides_px, (width, height) * 2, strict=True)
    )
    right, bottom = max(right, left + SIDE_MIN_PX), max(bottom, top + SIDE_MIN_PX)
    u, v, end_u, end_v = max(left, 0), max(top, 0), min(right, width), min(bottom, height)
    if u >= end_u or v >= end_v:
        return None
    edges = (v - top, bottom - end_v, u - left, right - end_u)
    return Window((slice(v, end_v), slice(u, end_u)), edges)


def bordered(inside: Image, edges: tuple[int, int, int, int], value: tuple[int, ...]) -> Image:
    """Return the inside of a window with a border of a value."""
    if not any(edges):
        return inside
    return cast(Image, cv2.copyMakeBorder(inside, *edges, cv2.BORDER_CONSTANT, value=value))


def reduced(rgb: U8, size_px: tuple[int, int]) -> U8:
    """Return an image at a height and width, reduced first by halves, which is fast."""
    height, width = size_px
    while rgb.shape[0] >= 2 * height and rgb.shape[1] >= 2 * width:
        even = rgb[: rgb.shape[0] // 2 * 2, : rgb.shape[1] // 2 * 2]
        rgb = cast(U8, cv2.resize(even, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    return cast(U8, cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA))
