"""Step length and cadence by the tracked feet, against the true steps."""

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.lib.gait.points import PointResults, in_map
from benchmarks.lib.gait.recordings import POINTS, GaitRecording
from benchmarks.lib.table import markdown
from evaluation.gait.step_errors import StepErrors, compare_steps
from people4d.messages import F64
from services.gait.steps.swings import FEET


def step_errors(recording: GaitRecording, results: PointResults, person: int) -> StepErrors:
    """Return the errors of the steps of one person in a recording."""
    rows = [POINTS.index(f"{foot}_foot") for foot in FEET]
    feet_m = in_map(recording, results.points_m[:, person])[:, rows]
    rotation = recording.map_from_optical[:3, :3]
    covariances_m2 = rotation @ results.covariances_m2[:, person][:, rows] @ rotation.T
    times_s = np.array([recording.world.frame_s(index) for index in range(len(feet_m))])
    return compare_steps(times_s, feet_m, recording.footfalls[person], covariances_m2)


def table(found: Mapping[str, Sequence[StepErrors]]) -> str:
    """Return the errors by case; each is of all recordings and seeds together."""
    header = [
        "case",
        "steps found, false steps",
        "one step: median, p90 cm",
        "measures published %",
        "mean step: bias, median, worst cm",
        "cadence: median, p90, worst %",
        "speed: median, worst %",
        "asymmetry: median, worst",
    ]
    return markdown(header, [[case, *_cells(errors)] for case, errors in found.items()])


def _cells(errors: Sequence[StepErrors]) -> list[str]:
    lengths = 100 * np.abs(np.concatenate([e.length_m for e in errors]))
    means = np.concatenate([e.means for e in errors]) * (100, 100, 100, 1)
    published = 100 * len(means) / max(sum(e.compared for e in errors), 1)
    counts = [sum(getattr(e, name) for e in errors) for name in ("found", "true", "extra")]
    return [
        "{} of {}, {}".format(*counts),
        _quantiles(lengths, (0.5, 0.9)),
        f"{published:.0f}",
        f"{means[:, 0].mean():+.1f}, {_quantiles(means[:, 0], (0.5, 1))}" if len(means) else "-",
        _quantiles(means[:, 1], (0.5, 0.9, 1)),
        _quantiles(means[:, 2], (0.5, 1)),
        _quantiles(means[:, 3], (0.5, 1), digits=2),
    ]


def _quantiles(values: F64, quantiles: Sequence[float], digits: int = 1) -> str:
    known = np.abs(values[np.isfinite(values)])
    if not len(known):
        return "-"
    return ", ".join(f"{value:.{digits}f}" for value in np.quantile(known, quantiles))
