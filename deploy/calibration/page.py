"""Page with the map of a calibration: cameras, their views, paths of people, and residuals."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from common.calibration.solve import CalibrationResult
from common.io.files import replace_file
from people4d.errors import SourceError
from people4d.messages import F64

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#999999", "#000000")
WIDTH_PX, MARGIN_M, VIEW_M = 900, 1.0, 1.2
STYLE = (
    "body{font:15px sans-serif;margin:2em;max-width:60em}td,th{padding:.2em .8em;text-align:left}"
)


def write_page(path: Path, found: CalibrationResult) -> None:
    """Write the page, which loads no other files; SourceError if the file cannot be written."""
    parts = [
        "<!doctype html><meta charset=utf-8><title>Calibration</title>",
        f"<style>{STYLE}</style><h1>Calibration by walking</h1>",
        "<p>Paths of people in each camera; they coincide if the poses are right. "
        "A square is 1 m.</p>",
        _map(found),
        "<h2>Cameras</h2>",
        _table(
            ("camera", "x, y, z [m]", "± [cm]", "± [deg]", "clock [ms]", "bias [cm]"),
            [
                (
                    name,
                    ", ".join(f"{v:.3f}" for v in matrix[:3, 3]),
                    f"{100 * found.poses[name].sigma_m:.1f}",
                    f"{np.degrees(found.poses[name].sigma_rad):.2f}",
                    f"{1e3 * found.poses[name].offset_s:.1f}",
                    f"{100 * found.poses[name].bias_m:.1f}",
                )
                for name, matrix in sorted(found.map_from_camera.items())
            ],
        ),
        f"<p>Relative to {escape(found.reference)}, one standard deviation. "
        f"{escape(floor_text(found))}</p>",
        "<h2>Pairs</h2>",
        _table(
            ("pair", "together [s]", "positions differ by [cm]"),
            [
                (f"{a} - {b}", f"{found.adjustment.pair_seconds[a, b]:.1f}", f"{100 * rms_m:.1f}")
                for (a, b), rms_m in sorted(found.adjustment.pair_rms_m.items())
            ],
        ),
    ]
    try:
        replace_file(path, ("\n".join(parts) + "\n").encode())
    except OSError as error:
        raise SourceError(f"{path} cannot be written: {error.strerror}") from error


def floor_text(found: CalibrationResult) -> str:
    """Return the basis of the floor as a sentence."""
    adjustment = found.adjustment
    if adjustment.floor:
        names, sigma_cm = ", ".join(adjustment.floor_cameras), 100 * adjustment.floor.sigma_m
        return f"The floor is measured in the depth of {names}, ± {sigma_cm:.1f} cm."
    if found.floor_people:
        return "The floor is at people's feet: no depth of it was received (camera.compressed_hz)."
    return "No feet were in view: the floor is where usual statures put it."


def _map(found: CalibrationResult) -> str:
    names = sorted(found.map_from_camera)
    points = [m[:2, 3][None] for m in found.map_from_camera.values()]
    points += [path[:, :2] for paths in found.paths_m.values() for path in paths]
    everything = np.concatenate(points)
    low, high = everything.min(axis=0) - MARGIN_M, everything.max(axis=0) + MARGIN_M
    scale = WIDTH_PX / max(high[0] - low[0], 1e-3)

    def to_px(at: F64) -> list[tuple[float, float]]:
        flipped = np.column_stack([at[:, 0] - low[0], high[1] - at[:, 1]]) * scale
        return [(float(x), float(y)) for x, y in flipped]

    height = (high[1] - low[1]) * scale
    lines = [f'<svg viewBox="0 0 {WIDTH_PX} {height:.0f}" width="{WIDTH_PX}">']
    across = [[[k, low[1]], [k, high[1]]] for k in range(int(np.ceil(low[0])), int(high[0]) + 1)]
    along = [[[low[0], k], [high[0], k]] for k in range(int(np.ceil(low[1])), int(high[1]) + 1)]
    lines += [_line(to_px(np.array(ends)), "#e4e4e4", 1) for ends in across + along]
    for k, name in enumerate(names):
        colour = COLOURS[k % len(COLOURS)]
        lines += [_line(to_px(path), colour, 1.5) for path in found.paths_m[name]]
        matrix = found.map_from_camera[name]
        ahead = matrix[:3, :3] @ np.array([[-0.5, 0.5], [0, 0], [1, 1]]) * VIEW_M
        corners = [
            matrix[:2, 3],
            (matrix[:3, 3] + ahead[:, 0])[:2],
            (matrix[:3, 3] + ahead[:, 1])[:2],
        ]
        lines.append(_line(to_px(np.array([*corners, corners[0]])), colour, 3))
        ((x, y),) = to_px(matrix[:2, 3][None])
        lines.append(f'<text x="{x + 6:.1f}" y="{y - 6:.1f}" fill="{colour}">{escape(name)}</text>')
    return "\n".join([*lines, "</svg>"])


def _line(points: Sequence[tuple[float, float]], colour: str, width: float) -> str:
    text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{text}" fill="none" stroke="{colour}" stroke-width="{width}"/>'


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"
