"""The contact sheet: frames, the map and the figures on one page."""

from collections.abc import Sequence

import numpy as np

from common.drawing.strokes import GREY, INK, PAPER, put_text, text_width
from common.drawing.tiles import GAP, Tile, grid
from common.drawing.topdown import Trajectories, draw_map
from people4d.messages import U8
from services.report.statistics import RunSummary
from services.report.text import facts, headline, latency_table

COLUMNS = 4
HEAD = 60  # [px] height of the head line
PANEL = 600  # [px] minimum height of map and figures
LINE = 24  # [px] distance of lines of text
TABLE_LINE = 0.85  # distance of lines of a table, relative to LINE
TEXT = 14.0  # [px] height of text
LEAST_WIDTH = 1440  # [px] minimum width, for the figures


def contact_sheet(tiles: Sequence[Tile], trajectories: Trajectories, summary: RunSummary) -> U8:
    """Return the page (HxWx3) of frames of one width, the map, and the figures."""
    frames = grid(tiles, COLUMNS) if tiles else np.full((0, LEAST_WIDTH, 3), PAPER, np.uint8)
    width = max(frames.shape[1], LEAST_WIDTH)
    lines = 2 * len(facts(summary)) + TABLE_LINE * len(latency_table(summary))
    panel = max(PANEL, round(LINE * (lines + 2)))
    page = np.full((HEAD + frames.shape[0] + panel, width, 3), PAPER, np.uint8)
    put_text(page, "people4d", (GAP * 2, 38), 24, INK)
    put_text(page, headline(summary), (GAP * 2 + text_width("people4d", 24) + 24, 38), 18, GREY)
    page[HEAD : HEAD + frames.shape[0], : frames.shape[1]] = frames
    map_width = width * 2 // 5
    below = page[HEAD + frames.shape[0] :]
    below[GAP:-GAP, GAP : GAP + map_width] = draw_map(trajectories, map_width, panel - 2 * GAP)
    _write_figures(below[:, map_width + 4 * GAP :], summary)
    return page


def _write_figures(area: U8, summary: RunSummary) -> None:
    """Write the facts, then the latency in columns, while there is room."""
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
