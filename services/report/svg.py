"""Plots as SVG in the colours of the page's style, light and dark."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from common.drawing.strokes import Colour
from common.drawing.topdown import Trajectories
from people4d.messages import F64

Pixel = Callable[[F64], tuple[float, float]]  # conversion from metres to pixels

WIDTH, HEIGHT = 640, 240
LEFT, RIGHT, TOP, BOTTOM = 48, 12, 12, 34
MAP_SIZE = 560
MAP_MARGIN_M = 0.5
MAP_LEAST_M = 3.0
VIEW_M = 1.2  # [m] length of the wedge of a camera
ROW = 26  # [px] height of a bar with its gap


@dataclass(frozen=True)
class Line:
    """A series of a plot."""

    name: str
    points: Sequence[tuple[float, float]]
    style: str  # class of the style sheet
    dots: bool = False  # True: separate points
    steps: bool = False  # True: constant until the next point


@dataclass(frozen=True)
class Bar:
    """A median with its 95th and 99th percentile."""

    name: str
    p50: float
    p95: float
    p99: float


def plot(lines: Sequence[Line], unit: str, title: str, *, end_s: float = 0.0) -> str:
    """Return series over at least `end_s` seconds; empty if there are no points."""
    points = [point for line in lines for point in line.points]
    if not points:
        return ""
    last_s, highest = (max(values) for values in zip(*points, strict=True))
    end_s, top = max(end_s, last_s, 1e-3), _nice(max(highest, 1e-6))
    parts = [_svg(WIDTH, HEIGHT, title)]
    for tick in _ticks(top):
        y = _y(tick, top)
        parts.append(f'<path class="grid" d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}"/>')
        parts.append(
            f'<text class="tick" x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>'
        )
    for tick in _ticks(_nice(end_s)):
        if tick <= end_s * 1.001:
            x = _x(tick, end_s)
            parts.append(
                f'<text class="tick" x="{x:.1f}" y="{HEIGHT - BOTTOM + 16}" '
                f'text-anchor="middle">{tick:g} s</text>'
            )
    parts.append(f'<path class="axis" d="M{LEFT} {HEIGHT - BOTTOM}H{WIDTH - RIGHT}"/>')
    parts += [_series(line, end_s, top) for line in lines]
    keys = "".join(
        f'<span class="key"><i class="{line.style}"></i>{escape(line.name)}</span>'
        for line in lines
    )
    return _figure(parts, f"{escape(title)} [{escape(unit)}] {keys}")


def bars(rows: Sequence[Bar], unit: str, title: str) -> str:
    """Return a bar up to the median of each row, with marks at the percentiles."""
    if not rows:
        return ""
    left = 16 + 7.4 * max(len(row.name) for row in rows)
    top = _nice(max(row.p99 for row in rows))
    height = ROW * len(rows) + BOTTOM
    scale = (WIDTH - left - RIGHT - 52) / top
    parts = [_svg(WIDTH, height, title)]
    for tick in _ticks(top):
        x = left + tick * scale
        parts.append(f'<path class="grid" d="M{x:.1f} 0V{height - BOTTOM}"/>')
        parts.append(
            f'<text class="tick" x="{x:.1f}" y="{height - 14}" text-anchor="middle">{tick:g}</text>'
        )
    for k, row in enumerate(rows):
        y = k * ROW + 4
        middle = y + (ROW - 8) / 2
        p50, p95, p99 = (left + max(v, 0.0) * scale for v in (row.p50, row.p95, row.p99))
        parts.append(
            f'<text class="name" x="{left - 8}" y="{middle + 4:.1f}" text-anchor="end">'
            f"{escape(row.name)}</text>"
            f'<rect class="bar" x="{left}" y="{y}" width="{max(p50 - left, 0.5):.1f}" '
            f'height="{ROW - 8}" rx="2"/>'
            f'<path class="whisker" d="M{p50:.1f} {middle}H{p99:.1f}'
            f"M{p95:.1f} {y + 3}V{y + ROW - 11}"
            f'M{p99:.1f} {y + 6}V{y + ROW - 14}"/>'
            f'<text class="tick" x="{p99 + 6:.1f}" y="{middle + 4:.1f}">{row.p50:.1f}</text>'
        )
    caption = (
        f"{escape(title)} [{escape(unit)}]: bar and figure: median; marks: 95th and 99th percentile"
    )
    return _figure(parts, caption)


def draw_map(trajectories: Trajectories, colours: dict[int, Colour]) -> str:
    """Return the top view, x up and y left; empty if there is no content."""
    paths = [*trajectories.tracks.values(), *trajectories.truth.values()]
    cameras = [camera[None, :2, 3] for camera in trajectories.cameras]
    if not paths and not cameras:
        return ""
    points = np.concatenate([*paths, *cameras])
    low, high = points.min(axis=0) - MAP_MARGIN_M, points.max(axis=0) + MAP_MARGIN_M
    extent = np.maximum(high - low, MAP_LEAST_M)
    centre = (low + high) / 2
    scale = MAP_SIZE / float(extent.max())
    width, height = (float(extent[1]) * scale, float(extent[0]) * scale)

    def pixel(point: F64) -> tuple[float, float]:
        x, y = (point - centre) * scale
        return width / 2 - float(y), height / 2 - float(x)

    parts = [_svg(round(width), round(height), "Map of the trajectories")]
    parts += _grid(centre, extent, pixel)
    for camera in trajectories.cameras:
        parts.append(_wedge(camera, pixel))
    parts += [
        f'<path class="truth" d="{_path(path, pixel)}"/>' for path in trajectories.truth.values()
    ]
    for track_id, path in trajectories.tracks.items():
        colour = "rgb({},{},{})".format(*colours[track_id])
        u, v = pixel(path[-1])
        parts.append(
            f'<path class="track" stroke="{colour}" d="{_path(path, pixel)}"/>'
            f'<circle fill="{colour}" cx="{u:.1f}" cy="{v:.1f}" r="5"/>'
            f'<text class="name" x="{u + 9:.1f}" y="{v + 4:.1f}">#{track_id}</text>'
        )
    truth = " Grey: ground truth." if trajectories.truth else ""
    caption = f"Top view of {escape(trajectories.frame_id)} (x up, y left), 1 m grid.{truth}"
    return _figure(parts, caption)


def _grid(centre: F64, extent: F64, pixel: Pixel) -> list[str]:
    low, high = centre - extent / 2, centre + extent / 2
    step = max(1, round(float(extent.max()) / 12))
    parts = []
    for axis in (0, 1):
        for metre in range(math.ceil(low[axis]), math.floor(high[axis]) + 1):
            if metre % step == 0:
                ends = np.stack([low, high])
                ends[:, axis] = metre
                parts.append(f'<path class="grid" d="{_path(ends, pixel)}"/>')
    return parts


def _wedge(camera: F64, pixel: Pixel) -> str:
    here, forward = camera[:2, 3], camera[:2, 2]
    length = float(np.linalg.norm(forward))
    if length < 1e-3:  # straight up or down
        return ""
    forward = forward / length * VIEW_M
    side = np.array([-forward[1], forward[0]]) * 0.52
    corners = np.stack([here, here + forward + side, here + forward - side])
    return f'<path class="camera" d="{_path(corners, pixel)}Z"/>'


def _series(line: Line, end_s: float, top: float) -> str:
    pixels = [(_x(x, end_s), _y(y, top)) for x, y in line.points]
    if line.dots:
        circles = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.2"/>' for x, y in pixels)
        return f'<g class="dots {line.style}">{circles}</g>'
    words = []
    for k, (x, y) in enumerate(pixels):
        if k and line.steps:
            words.append(f"H{x:.1f}V{y:.1f}")
        else:
            words.append(f"{'L' if k else 'M'}{x:.1f} {y:.1f}")
    return f'<path class="line {line.style}" d="{"".join(words)}"/>'


def _path(points: F64, pixel: Pixel) -> str:
    return "M" + "L".join(f"{u:.1f} {v:.1f}" for u, v in map(pixel, points))


def _svg(width: int, height: int, title: str) -> str:
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title)}" '
        'xmlns="http://www.w3.org/2000/svg">'
    )


def _figure(parts: Sequence[str], caption: str) -> str:
    """Return a figure of an SVG's parts, with a caption in HTML."""
    return f"<figure>{''.join(parts)}</svg><figcaption>{caption}</figcaption></figure>"


def _x(value: float, end: float) -> float:
    return LEFT + value / end * (WIDTH - LEFT - RIGHT)


def _y(value: float, top: float) -> float:
    return HEIGHT - BOTTOM - value / top * (HEIGHT - TOP - BOTTOM)


def _nice(value: float) -> float:
    """Return the next of 1, 2, 2.5, 5, 10 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(power * step for step in (1, 2, 2.5, 5, 10) if value <= power * step * 1.000001)


def _ticks(top: float) -> list[float]:
    mantissa = top / 10.0 ** math.floor(math.log10(top) + 1e-9)
    count = 4 if abs(mantissa - 2) < 0.01 else 5
    return [round(top * k / count, 10) for k in range(count + 1)]
