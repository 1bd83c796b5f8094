"""Paths of points and their course over time, drawn with matplotlib, an extra of this package."""

from io import BytesIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from evaluation.gait.log import Log, Trail
from evaluation.gait.look import colour_of_point
from services.gait.points.points import LEFT_FOOT, RIGHT_FOOT

DPI = 110
AXES = ("x (m)", "y (m)", "height (m)")


def paths(log: Log, person: int) -> bytes:
    """Draw where the points of a person went, from above and from the side, as a PNG file."""
    figure = Figure((11, 5), layout="constrained")
    above, beside = figure.subplots(1, 2)
    for name, trail in log.trails(person).items():
        colour = _hex(name)
        x, y = _broken(trail, 0)[1], _broken(trail, 1)[1]
        above.plot(y, x, color=colour, lw=1.2, label=_words(name))
        beside.plot(*_broken(trail, 2), color=colour, lw=1.2)
    above.set(xlabel=AXES[1], ylabel=AXES[0], aspect="equal", title=f"person {person} from above")
    above.invert_xaxis()  # y to the left, x up, as one looks with the camera
    beside.set(xlabel="time (s)", ylabel=AXES[2], title="height")
    for axes in (above, beside):
        axes.grid(alpha=0.3)
    _legend(above)
    return _png(figure)


def steps(log: Log, person: int) -> bytes:
    """Draw the feet of a person over time, and where they came down, as a PNG file."""
    figure = Figure((11, 5), layout="constrained")
    rows = figure.subplots(2, 1, sharex=True)
    trails, found = log.trails(person), log.steps(person)
    for name in (LEFT_FOOT, RIGHT_FOOT):
        if name in trails:
            for k, axes in enumerate(rows):
                axes.plot(*_broken(trails[name], k), color=_hex(name), lw=1.3, label=_words(name))
    for step in found:
        for axes in rows:
            axes.axvline(step.landed_s, color=_hex(f"{step.foot}_foot"), lw=0.9, ls=":")
    rows[0].set(ylabel=AXES[0], title=_summary(log, person))
    rows[1].set(ylabel=AXES[1], xlabel="time (s)")
    for axes in rows:
        axes.grid(alpha=0.3)
    _legend(rows[0])
    return _png(figure)


def _legend(axes: Axes) -> None:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8)


def _summary(log: Log, person: int) -> str:
    told = log.measures(person)
    if told.step_length_m is None or told.cadence_per_min is None:
        return f"person {person}: too few steps to tell"
    return (
        f"person {person}: {told.steps} steps of {told.step_length_m:.2f} m, "
        f"{told.cadence_per_min:.0f} a minute, dotted where a foot came down"
    )


def _broken(trail: Trail, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of a point with gaps where it was not told."""
    gaps = np.flatnonzero(np.diff(trail.times_s) > 0.5) + 1
    values = np.insert(trail.positions_m[:, axis], gaps, np.nan)
    return np.insert(trail.times_s, gaps, np.nan), values


def _words(name: str) -> str:
    return name.replace("_", " ")


def _hex(name: str) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour_of_point(name))


def _png(figure: Figure) -> bytes:
    file = BytesIO()
    figure.set_dpi(DPI)
    figure.savefig(file, format="png", metadata={"Software": None})
    return file.getvalue()
