"""TRC files of points, which OpenSim and other tools of biomechanics read."""

from collections.abc import Mapping

import numpy as np

from evaluation.gait.tables import PointTrajectory

# y of TRC is up: x, y, z there are x, z, -y of a frame whose z is up.
AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
FIELDS = (
    *("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"),
    *("OrigDataRate", "OrigDataStartFrame", "OrigNumFrames"),
)


def trc_text(trajectories: Mapping[str, PointTrajectory], name: str) -> str:
    """Return the text of a TRC file: a marker for each point in mm, empty where it is lost."""
    times_s = np.unique(np.concatenate([one.times_s for one in trajectories.values()]))
    rate_hz = 1 / float(np.median(np.diff(times_s))) if len(times_s) > 1 else 1.0
    cells = np.full((len(times_s), 3 * len(trajectories)), "", dtype=object)
    for k, one in enumerate(trajectories.values()):
        rows = np.searchsorted(times_s, one.times_s)
        positions_mm = 1000 * one.positions_m @ AXES.T
        for row, position in zip(rows.tolist(), positions_mm, strict=True):
            cells[row, 3 * k : 3 * k + 3] = [f"{value:.2f}" for value in position]
    rate, frames, markers = f"{rate_hz:.2f}", str(len(times_s)), str(len(trajectories))
    axes = [f"{axis}{k + 1}" for k in range(len(trajectories)) for axis in "XYZ"]
    lines = [
        ["PathFileType", "4", "(X/Y/Z)", name],
        list(FIELDS),
        [rate, rate, frames, markers, "mm", rate, "1", frames],
        ["Frame#", "Time", *(cell for one in trajectories for cell in (one, "", ""))],
        ["", "", *axes],
        [],
    ]
    lines += [[str(k + 1), f"{time_s:.4f}", *cells[k]] for k, time_s in enumerate(times_s.tolist())]
    return "".join("\t".join(line) + "\n" for line in lines)
