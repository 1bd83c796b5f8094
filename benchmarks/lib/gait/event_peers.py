"""Landings by the event detectors of other packages, on our positions of body and feet."""

import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from people4d.messages import F64
from services.gait.points.keypoints import HEAD, LEFT_FOOT, RIGHT_FOOT
from services.gait.steps.steps import FEET, PointTrajectory, Side
from services.gait.steps.walk import WalkSamples, fit_walk

STARTS = ("benchmarks.lib.gait.peer_events",)
SCRIPT = Path(__file__).with_name("peer_events.py")
PeerLandings = Mapping[str, Mapping[str, Sequence[tuple[float, Side]]]]  # by method and walk
Walk = Mapping[str, PointTrajectory]


def peer_landings(python: str, walks: Mapping[str, Walk]) -> PeerLandings:
    """Return the landings by method and walk; `python` is the packages' interpreter."""
    arrays, begins_s = dict[str, F64](), dict[str, float]()
    for name, walk in walks.items():
        if {HEAD, LEFT_FOOT, RIGHT_FOOT} <= walk.keys() and len(walk[HEAD].times_s) > 1:
            times_s = grid_s(walk[HEAD].times_s)
            rate = np.array(1 / (times_s[1] - times_s[0]))
            arrays |= {name: along_path(times_s, walk), f"{name}:hz": rate}
            begins_s[name] = float(times_s[0])
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "walks.npz", Path(folder) / "events.npz"
        np.savez(source, allow_pickle=False, **arrays)
        subprocess.run([python, "-P", str(SCRIPT), str(source), str(target)], check=True)
        with np.load(target) as file:
            outputs = dict(file)
    found: dict[str, dict[str, Sequence[tuple[float, Side]]]] = {}
    for key, rows in outputs.items():
        method, _, name = key.partition("/")
        landed = [
            (begins_s[name] + time_s, FEET[int(side)]) for time_s, side in sorted(rows.tolist())
        ]
        found.setdefault(method, dict.fromkeys(walks, ()))[name] = landed
    return found


def grid_s(times_s: F64) -> F64:
    """Return even times at the median rate."""
    step_s = float(np.median(np.diff(times_s)))
    count = max(round((times_s[-1] - times_s[0]) / step_s), 1) + 1
    return np.asarray(times_s[0] + step_s * np.arange(count))


def along_path(times_s: F64, walk: Walk) -> F64:
    """Return body and feet ahead along the path, to its left and up, Nx3x3.

    The detectors expect a straight walk without gaps.
    """
    body_m, *feet_m = (
        np.stack([np.interp(times_s, one.times_s, column) for column in one.points_m.T], axis=1)
        for one in (walk[HEAD], walk[LEFT_FOOT], walk[RIGHT_FOOT])
    )
    feet = np.stack(feet_m, axis=1)
    covariances_m2 = np.zeros((len(times_s), 2, 2, 2))
    fit = fit_walk(WalkSamples(times_s, body_m[:, :2], feet[..., :2], covariances_m2))
    axes = np.stack([fit.headings, fit.headings[:, ::-1] * (-1.0, 1.0)], axis=1)
    path_m = np.cumsum(
        np.sum(np.diff(fit.body_m, axis=0, prepend=fit.body_m[:1]) * fit.headings, 1)
    )
    found = np.zeros((len(times_s), 3, 3))
    found[:, 0, 2] = body_m[:, 2]
    found[:, 1:, :2] = np.einsum("nij,nfj->nfi", axes, feet[..., :2] - fit.body_m[:, None])
    found[:, 1:, 2] = feet[..., 2]
    found[..., 0] += path_m[:, None]
    return found
