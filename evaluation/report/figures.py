"""Figures of trajectories and errors, drawn with matplotlib, an optional dependency."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Wedge

from common.drawing.strokes import Colour, colour_of
from common.metrics.record import I64
from common.metrics.scores import Scores
from evaluation.report.trajectories import YAW, CameraCoverage, RunTrajectories, X, Y
from people4d.messages import F64

WINDOW_S = 8.0  # [s] duration of a floor plan
SERIES_S = 40.0  # [s] duration of a time series
METHODS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b", "#e377c2", "#17becf")
STRIPES = ("solid", (0, (6, 1.5)), (0, (1.5, 1.5)))
ARROW_M = 0.35
BINS = 60
DPI = 110
HISTOGRAMS = {
    "position across (m)": (-0.5, 0.5),
    "position along the camera's axis (m)": (-0.5, 0.5),
    "yaw (°)": (0, 180),
    "velocity across (m/s)": (-1, 1),
    "velocity along the camera's axis (m/s)": (-1, 1),
}


def floor_plans(recording: str, runs: Sequence[RunTrajectories]) -> bytes:
    """Draw the trajectories of all methods on a recording, a panel for each, as a PNG file."""
    start_s, end_s = _window(runs)
    columns = min(3, len(runs))
    rows = -(-len(runs) // columns)
    figure = Figure((4.2 * columns, 4.6 * rows + 0.4), layout="constrained")
    figure.suptitle(f"{recording}: {start_s:.1f} to {end_s:.1f} s", fontsize=11)
    low, high = _extent(runs[0], start_s, end_s)
    for k, run in enumerate(runs):
        axes = figure.add_subplot(rows, columns, k + 1)
        _floor_plan(axes, run, start_s, end_s)
        axes.set(title=run.method, xlabel="y (m)", ylabel="x (m)", aspect="equal")
        axes.set_xlim(high[1], low[1])  # y to the left, x up, as in the view of the camera
        axes.set_ylim(low[0], high[0])
        axes.grid(alpha=0.3)
    return png_of(figure)


def time_series(recording: str, runs: Sequence[RunTrajectories]) -> bytes:
    """Draw position, velocity and yaw of the person with most frames, all methods, as PNG."""
    first = runs[0]
    person = int(np.argmax(first.required.sum(axis=0)))
    figure = Figure((11, 9.5), layout="constrained")
    panels = figure.subplots(5, 1, sharex=True)
    figure.suptitle(f"{recording}: person {first.persons[person]}", fontsize=11)
    titles = ("x (m)", "y (m)", "v$_x$ (m/s)", "v$_y$ (m/s)", "yaw (°)")
    for column, (axes, title) in enumerate(zip(panels, titles, strict=True)):
        _series(axes, runs, person, column)
        axes.set_ylabel(title)
        axes.grid(alpha=0.3)
    panels[YAW].set(ylim=(-185, 185), yticks=(-180, -90, 0, 90, 180))
    panels[-1].set_xlabel("time (s); grey: out of view or occluded")
    panels[0].set_xlim(first.stamps_s[0], min(first.stamps_s[-1], first.stamps_s[0] + SERIES_S))
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return png_of(figure)


def histograms(pooled: Mapping[str, Scores]) -> bytes:
    """Draw the distribution of the errors over all recordings, by name of the method, as PNG."""
    figure = Figure((11, 6.5), layout="constrained")
    panels = figure.subplots(2, 3).ravel()
    for k, (method, scores) in enumerate(pooled.items()):
        poses = scores.pose
        position_m = poses.along_across(poses.position_m)
        velocity_mps = poses.along_across(poses.velocity_mps)
        yaw_deg = np.degrees(poses.yaw_error_rad)
        samples = (*position_m.T[::-1], yaw_deg, *velocity_mps.T[::-1])
        for axes, values, limits in zip(panels, samples, HISTOGRAMS.values(), strict=False):
            known = np.clip(values[np.isfinite(values)], *limits)
            if len(known):
                weights = np.full(len(known), 100 / len(known))
                style = {"histtype": "step", "lw": 1.4, **_style(k, method)}
                axes.hist(known, BINS, range=limits, weights=weights, **style)
    for axes, (title, limits) in zip(panels, HISTOGRAMS.items(), strict=False):
        axes.set(xlabel=title, xlim=limits, ylabel="% of poses")
        axes.grid(alpha=0.3)
    panels[-1].axis("off")
    panels[-1].legend(*panels[0].get_legend_handles_labels(), loc="center", frameon=False)
    return png_of(figure)


def _floor_plan(axes: Axes, run: RunTrajectories, start_s: float, end_s: float) -> None:
    if run.camera:
        _draw_camera(axes, run.camera)
    rows = (run.stamps_s >= start_s) & (run.stamps_s <= end_s)
    for k in range(len(run.persons)):
        true = run.true[rows, k]
        axes.plot(true[:, Y], true[:, X], "k--", lw=1.2, zorder=3)
        _arrow(axes, true, "black")
    for identity, path in run.paths.items():
        tracked = path[(path[:, 0] >= start_s) & (path[:, 0] <= end_s), 1:]
        if len(tracked):
            colour = hex_of(colour_of(identity))
            dot = "o" if len(tracked) == 1 else None
            axes.plot(tracked[:, Y], tracked[:, X], color=colour, lw=2, ms=3, marker=dot, zorder=2)
            _arrow(axes, tracked, colour)
            style: dict[str, Any] = {"color": colour, "fontsize": 8, "textcoords": "offset points"}
            end = tracked[-1, Y], tracked[-1, X]
            axes.annotate(f"ID {identity}", end, xytext=(5, -11), **style)


def _arrow(axes: Axes, path: F64, colour: str) -> None:
    """Draw the last known yaw of a path."""
    known = path[np.isfinite(path[:, [X, Y, YAW]]).all(axis=1)]
    if len(known):
        x, y, yaw_rad = known[-1, X], known[-1, Y], known[-1, YAW]
        tip = (y + ARROW_M * np.sin(yaw_rad), x + ARROW_M * np.cos(yaw_rad))
        axes.annotate("", tip, (y, x), arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6})


def _draw_camera(axes: Axes, camera: CameraCoverage) -> None:
    x, y = camera.position_m
    # In the plot y points left and x up: angles from x towards y are measured from the vertical.
    middle_deg, half_deg = np.degrees((np.pi / 2 - camera.axis_rad, camera.half_angle_rad))
    wedge = (y, x), camera.range_m, middle_deg - half_deg, middle_deg + half_deg
    axes.add_patch(Wedge(*wedge, color="0.5", alpha=0.13, lw=0, zorder=0))
    axes.plot([y], [x], "o", color="red", ms=6, zorder=4)


def _series(axes: Axes, runs: Sequence[RunTrajectories], person: int, column: int) -> None:
    first = runs[0]
    scale = 180 / np.pi if column == YAW else 1.0
    truth = first.true[:, person, column] * scale
    for start, end in _runs(~first.required[:, person]):
        axes.axvspan(first.stamps_s[start], first.stamps_s[end], color="0.85", lw=0)
    for k, run in enumerate(runs):
        tracked = run.tracked[:, person, column] * scale
        # Lines are interrupted between two tracks, and where an angle wraps.
        breaks = np.flatnonzero(np.diff(run.tracks[:, person]) != 0)
        axes.plot(*_broken(run.stamps_s, tracked, breaks, column), lw=1.2, **_style(k, run.method))
    none = np.zeros(0, np.int64)
    axes.plot(*_broken(first.stamps_s, truth, none, column), "k--", lw=1.1, label="truth")


def _broken(times_s: F64, values: F64, gaps: I64, column: int) -> tuple[F64, F64]:
    """Insert gaps after some samples, and where an angle wraps."""
    if column == YAW:
        gaps = np.union1d(gaps, np.flatnonzero(np.abs(np.diff(values)) > 180))
    return np.insert(times_s, gaps + 1, times_s[gaps]), np.insert(values, gaps + 1, np.nan)


def _runs(marks: np.ndarray) -> list[tuple[int, int]]:
    """Return first and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marks, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]


def _window(runs: Sequence[RunTrajectories]) -> tuple[float, float]:
    """Return the time with the most ID switches of all methods, else the middle."""
    first_s, last_s = float(runs[0].stamps_s[0]), float(runs[0].stamps_s[-1])
    if last_s - first_s <= WINDOW_S * 1.5:
        return first_s, last_s
    switches_s = np.array([t for run in runs for t in run.switches_s])
    starts_s = np.arange(first_s, last_s - WINDOW_S + 1e-9, 0.5)
    since_s = switches_s - starts_s[:, None]
    counts = ((since_s >= 1) & (since_s <= WINDOW_S - 1)).sum(axis=1)
    best = np.flatnonzero(counts == counts.max())
    start_s = float(starts_s[best[len(best) // 2]])
    return start_s, start_s + WINDOW_S


def _extent(run: RunTrajectories, start_s: float, end_s: float) -> tuple[F64, F64]:
    rows = (run.stamps_s >= start_s) & (run.stamps_s <= end_s)
    points = run.true[rows][..., :2].reshape(-1, 2)
    points = points[np.isfinite(points).all(axis=1)]
    if run.camera:
        c = run.camera
        angles = c.axis_rad + np.linspace(-c.half_angle_rad, c.half_angle_rad, 9)
        rim = c.position_m + c.range_m * np.column_stack([np.cos(angles), np.sin(angles)])
        points = np.concatenate([points, rim, c.position_m[None]])
    if not len(points):
        return np.zeros(2), np.ones(2)
    return points.min(axis=0) - 0.3, points.max(axis=0) + 0.3


def _style(k: int, method: str) -> dict[str, Any]:
    return {
        "color": METHODS[k % len(METHODS)],
        "ls": STRIPES[k // len(METHODS) % len(STRIPES)],
        "label": method,
    }


def hex_of(colour: Colour) -> str:
    """Return a colour in the form of matplotlib."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def png_of(figure: Figure) -> bytes:
    """Return a figure as a PNG file, the same bytes for the same figure."""
    file = BytesIO()
    figure.set_dpi(DPI)
    figure.savefig(file, format="png", metadata={"Software": None})
    return file.getvalue()
