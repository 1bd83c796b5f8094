"""Figure of errors over time, as Figure 5.7 of the source."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.lib.gait.points import PointResults

mpl.use("Agg")

COLOURS = {"spin": "#d55e00", "geodesic": "#009e73", "combined": "#0072b2"}
FPS = 30.0
SMOOTH = 7  # frames, over which the median is taken
TOP_CM = 100.0


def draw(
    runs: Mapping[tuple[str, str], Sequence[PointResults]],
    cases: Mapping[str, str],
    features: Sequence[str],
    point: int,
    file: Path,
) -> None:
    """Draw the error of one point over time, by case and feature.

    Args:
        runs: By case and feature; the median of them all is drawn, and thinly each one.
        cases: One above the other.
        features: Each in its colour.
        point: Number of the point.
        file: PNG to be written.
    """
    figure = Figure(figsize=(9, 7), layout="constrained")
    for axes, case in zip(figure.subplots(len(cases), 1), cases.values(), strict=True):
        for feature in features:
            errors = np.array([100 * run.errors_m[:, 0, point] for run in runs[case, feature]])
            times_s = np.arange(errors.shape[1]) / FPS
            for one in errors:
                axes.plot(times_s, one, color=COLOURS[feature], lw=0.5, alpha=0.35)
            middle = [
                _median(errors[:, max(k - SMOOTH // 2, 0) : k + SMOOTH // 2 + 1])
                for k in range(errors.shape[1])
            ]
            axes.plot(times_s, middle, color=COLOURS[feature], lw=1.8, label=feature)
        axes.set_title(case, fontsize=10, loc="left")
        axes.set_ylabel("error [cm]")
        axes.set_ylim(0, TOP_CM)
        axes.grid(color="#dddddd", lw=0.5)
        axes.set_axisbelow(True)
    axes.set_xlabel("time [s]; gaps: the hand is occluded")
    figure.axes[0].legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=100)


def _median(values: "np.ndarray") -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")
