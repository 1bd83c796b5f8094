"""Plots as SVG in the colours of the page's style, light and dark."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

WIDTH, HEIGHT = 640, 240
LEFT, RIGHT, TOP, BOTTOM = 48, 12, 12, 34
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
