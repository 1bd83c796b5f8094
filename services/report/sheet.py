"""The contact sheet: frames, the map and the figures on one page."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from common.messages import U8
from services.report.palette import GREY, INK, PAPER, Colour
from services.report.statistics import Summary
from services.report.strokes import put_label, put_text, text_width
from services.report.text import facts, headline, latency_table
from services.report.topdown import Walks, draw_map

COLUMNS = 4
GAP = 8  # [px] between tiles
TALLEST = 2  # times its width: a tile of a stranger image is squeezed
HEAD = 60  # [px] height of the head line
PANEL = 600  # [px] least height of map and figures
LINE = 24  # [px] from one line of text to the next
TABLE_LINE = 0.85  # of LINE
TEXT = 14.0  # [px] height of text
LEAST_WIDTH = 1440  # [px] so that the figures have room where there are few tiles
TILE_EDGE: Colour = (60, 66, 74)


@dataclass(frozen=True, slots=True)
class Tile:
    """One annotated frame, already as small as it is shown."""

    image: U8  # HxWx3, red first
    caption: str


def shrink(image: U8, width: int) -> U8:
    """Return an image scaled to a width in pixels, its proportions kept."""
    height = min(max(1, round(image.shape[0] * width / image.shape[1])), TALLEST * width)
    small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def contact_sheet(tiles: Sequence[Tile], walks: Walks, summary: Summary) -> U8:
    """Compose the page.

    Args:
        tiles: Frames in order of time, all of one width.
        walks: What the map shows.
        summary: Figures.

    Returns:
        HxWx3, red first.
    """
    grid = _grid(tiles)
    width = max(grid.shape[1], LEAST_WIDTH)
    lines = 2 * len(facts(summary)) + TABLE_LINE * len(latency_table(summary))
    panel = max(PANEL, round(LINE * (lines + 2)))
    page = np.full((HEAD + grid.shape[0] + panel, width, 3), PAPER, np.uint8)
    put_text(page, "people4d", (GAP * 2, 38), 24, INK)
    put_text(page, headline(summary), (GAP * 2 + text_width("people4d", 24) + 24, 38), 18, GREY)
    page[HEAD : HEAD + grid.shape[0], : grid.shape[1]] = grid
    map_width = width * 2 // 5
    below = page[HEAD + grid.shape[0] :]
    below[GAP:-GAP, GAP : GAP + map_width] = draw_map(walks, map_width, panel - 2 * GAP)
    _write_figures(below[:, map_width + 4 * GAP :], summary)
    return page


def _grid(tiles: Sequence[Tile]) -> U8:
    """Lay tiles out in rows; the tallest sets the height of all."""
    if not tiles:
        return np.full((0, LEAST_WIDTH, 3), PAPER, np.uint8)
    columns = min(COLUMNS, len(tiles))
    rows = -(-len(tiles) // columns)
    height, width = max(t.image.shape[0] for t in tiles), tiles[0].image.shape[1]
    shape = rows * (height + GAP) + GAP, columns * (width + GAP) + GAP, 3
    grid = np.full(shape, PAPER, np.uint8)
    for k, tile in enumerate(tiles):
        top, left = (GAP + k // columns * (height + GAP)), (GAP + k % columns * (width + GAP))
        place = grid[top : top + tile.image.shape[0], left : left + width]
        place[:] = tile.image[:, :width]
        put_label(place, tile.caption, (0, place.shape[0]), 11, TILE_EDGE)
    return grid


def _write_figures(area: U8, summary: Summary) -> None:
    """Write the facts, then the latency in columns, as far as there is room."""
    base = float(GAP + LINE)
    for name, sentence in facts(summary):
        put_text(area, name, (0, base), TEXT, GREY)
        for line in _wrap(sentence, area.shape[1] - 110):
            put_text(area, line, (90, base), TEXT, INK)
            base += LINE
    base += LINE / 2
    for k, row in enumerate(latency_table(summary)):
        if base > area.shape[0] - GAP:
            return
        for text, right in zip(row, (0, 380, 470, 560), strict=True):
            left = right - text_width(text, TEXT) if right else 0
            put_text(area, text, (left, base), TEXT, INK if k else GREY)
        base += LINE * TABLE_LINE


def _wrap(sentence: str, width: int) -> list[str]:
    """Break a sentence at commas so that each line fits into a width in pixels."""
    lines: list[str] = []
    for part in sentence.split(", "):
        if lines and text_width(f"{lines[-1]}, {part}", TEXT) <= width:
            lines[-1] += f", {part}"
        else:
            lines.append(part)
    return lines
