"""Plots of point trajectories and steps, with matplotlib, an extra of this package."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from evaluation.gait.tables import GaitTables, PointTrajectory
from evaluation.gait.viewer import point_colour
from evaluation.report.figures import hex_of, png_of
from services.gait.points.keypoints import LEFT_FOOT, RIGHT_FOOT

AXES = ("x (m)", "y (m)", "height (m)")
GAP_S = 0.5


def trajectories_png(tables: GaitTables, person: int) -> bytes:
    """Plot the trajectories of a person's points from above, and their heights."""
    figure = Figure((11, 5), layout="constrained")
    above, beside = figure.subplots(1, 2)
    for name, trajectory in tables.trajectories(person).items():
        colour = _hex(name)
        x, y = _with_gaps(trajectory, 0)[1], _with_gaps(trajectory, 1)[1]
        above.plot(y, x, color=colour, lw=1.2, label=_label(name))
        beside.plot(*_with_gaps(trajectory, 2), color=colour, lw=1.2)
    above.set(xlabel=AXES[1], ylabel=AXES[0], aspect="equal", title=f"person {person} from above")
    above.invert_xaxis()  # y to the left, x up, as in the direction of the camera
    beside.set(xlabel="time (s)", ylabel=AXES[2], title="height")
    for axes in (above, beside):
        axes.grid(alpha=0.3)
    _legend(above)
    return png_of(figure)


def steps_png(tables: GaitTables, person: int) -> bytes:
    """Plot the feet of a person over time, and their landings."""
    figure = Figure((11, 5), layout="constrained")
    rows = figure.subplots(2, 1, sharex=True)
    trajectories = tables.trajectories(person)
    for name in (LEFT_FOOT, RIGHT_FOOT):
        if name in trajectories:
            for k, axes in enumerate(rows):
                line = _with_gaps(trajectories[name], k)
                axes.plot(*line, color=_hex(name), lw=1.3, label=_label(name))
    for step in tables.steps(person):
        for axes in rows:
            axes.axvline(step.landed_s, color=_hex(f"{step.foot}_foot"), lw=0.9, ls=":")
    rows[0].set(ylabel=AXES[0], title=_summary(tables, person))
    rows[1].set(ylabel=AXES[1], xlabel="time (s)")
    for axes in rows:
        axes.grid(alpha=0.3)
    _legend(rows[0])
    return png_of(figure)


def _legend(axes: Axes) -> None:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8)


def _summary(tables: GaitTables, person: int) -> str:
    measures = tables.measures(person)
    if measures.step_length_m is None or measures.cadence_per_min is None:
        return f"person {person}: too few steps"
    return (
        f"person {person}: {measures.steps} steps of {measures.step_length_m:.2f} m, "
        f"{measures.cadence_per_min:.0f} a minute, landings dotted"
    )


def _with_gaps(trajectory: PointTrajectory, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of a point with NaN in its gaps."""
    gaps = np.flatnonzero(np.diff(trajectory.times_s) > GAP_S) + 1
    values = np.insert(trajectory.positions_m[:, axis], gaps, np.nan)
    return np.insert(trajectory.times_s, gaps, np.nan), values


def _label(name: str) -> str:
    return name.replace("_", " ")


def _hex(name: str) -> str:
    return hex_of(point_colour(name))
