"""Small images in rows, each with a caption."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from common.drawing.strokes import PAPER, Colour, put_label
from people4d.messages import U8

GAP = 8  # gap between tiles [px]
TALLEST = 2  # maximum height over width; a tile of a taller image is squeezed
EDGE: Colour = (60, 66, 74)


@dataclass(frozen=True, slots=True)
class Tile:
    """One annotated frame, already scaled."""

    image: U8  # HxWx3, red first
    caption: str


def shrink(image: U8, width: int) -> U8:
    """Return an image scaled to a width in pixels, in proportion."""
    height = min(max(1, round(image.shape[0] * width / image.shape[1])), TALLEST * width)
    small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def grid(tiles: Sequence[Tile], columns: int) -> U8:
    """Arrange tiles of one width in rows on a page; all have the height of the tallest."""
    columns = min(columns, len(tiles))
    rows = -(-len(tiles) // columns)
    height, width = max(t.image.shape[0] for t in tiles), tiles[0].image.shape[1]
    shape = rows * (height + GAP) + GAP, columns * (width + GAP) + GAP, 3
    page = np.full(shape, PAPER, np.uint8)
    for k, tile in enumerate(tiles):
        top, left = (GAP + k // columns * (height + GAP)), (GAP + k % columns * (width + GAP))
        cell = page[top : top + tile.image.shape[0], left : left + width]
        cell[:] = tile.image[:, :width]
        put_label(cell, tile.caption, (0, cell.shape[0]), 11, EDGE)
    return page
