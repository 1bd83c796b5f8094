"""Tables of the points, steps and gait measures of a recording."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from evaluation.gait.motion import ANGLE_FIELDS, JointMotion, angle_rows, motion_of
from evaluation.report.csv_files import write_csv
from people4d.messages import BodyPoint, GaitMeasures, PersonSkeleton, Skeletons
from services.gait.estimator import GaitResult
from services.gait.points.keypoints import HEAD, LEFT_FOOT, RIGHT_FOOT
from services.gait.steps.steps import FootStep, PointTrajectory, find_steps, gait_measures

POINT_FIELDS = (
    *("time_s", "person", "point", "state", "x_m", "y_m", "z_m", "vx_mps", "vy_mps", "vz_mps"),
    *("sigma_x_m", "sigma_y_m", "sigma_z_m", "confidence"),
)
STEP_FIELDS = (
    *("person", "foot", "landed_s", "step_length_m", "stride_length_m", "stride_s"),
    *("confidence", "observed"),
)


@dataclass(frozen=True)
class _Row:
    time_s: float
    person: int
    point: BodyPoint


class GaitTables:
    """Collects the results of all frames."""

    def __init__(self) -> None:
        self._rows: list[_Row] = []
        self._start_ns: int | None = None
        self._skeletons: dict[int, list[tuple[float, PersonSkeleton]]] = defaultdict(list)

    def add_frame(self, stamp_ns: int, results: Sequence[GaitResult]) -> float:
        """Add a frame and return the seconds since the first one."""
        self._start_ns = stamp_ns if self._start_ns is None else self._start_ns
        time_s = (stamp_ns - self._start_ns) / 1e9
        self._rows += [_Row(time_s, one.person.id, p) for one in results for p in one.person.points]
        return time_s

    def add_skeletons(self, message: Skeletons) -> None:
        """Add the skeletons of a frame, after its results."""
        self._start_ns = message.stamp_ns if self._start_ns is None else self._start_ns
        time_s = (message.stamp_ns - self._start_ns) / 1e9
        for one in message.people:
            self._skeletons[one.id].append((time_s, one))

    @property
    def people(self) -> tuple[int, ...]:
        """Ids of the people with points."""
        return tuple(sorted({row.person for row in self._rows}))

    def trajectories(self, person: int) -> Mapping[str, PointTrajectory]:
        """Return the trajectories of a person's points by name, without samples while lost."""
        rows: dict[str, list[_Row]] = defaultdict(list)
        for row in self._rows:
            if row.person == person and row.point.state != "lost":
                rows[row.point.name].append(row)
        return {
            name: PointTrajectory(
                np.array([row.time_s for row in own]),
                np.array([row.point.position_m for row in own]),
                np.array([row.point.covariance[:3, :3] for row in own]),
            )
            for name, own in rows.items()
        }

    def steps(self, person: int) -> list[FootStep]:
        """Return all steps of a person."""
        found = self.trajectories(person)
        if not {HEAD, LEFT_FOOT, RIGHT_FOOT} <= found.keys():
            return []
        return find_steps(found[HEAD], found[LEFT_FOOT], found[RIGHT_FOOT])

    def motion(self, person: int) -> JointMotion | None:
        """Return the joints of a person over all frames; None if they are not known."""
        known = self._skeletons.get(person, ())
        return motion_of([time_s for time_s, _ in known], [one for _, one in known])

    def measures(self, person: int) -> GaitMeasures:
        """Return the gait measures of a person over all steps."""
        return gait_measures(self.steps(person))

    def write(self, folder: Path) -> None:
        """Write gait.csv, steps.csv, measures.csv and joint_angles.csv.

        Raises:
            SourceError: A file cannot be written.
        """
        write_csv(folder / "gait.csv", POINT_FIELDS, map(_cells, self._rows))
        write_csv(folder / "steps.csv", STEP_FIELDS, self._step_cells())
        rows = ([one, *msgspec.structs.astuple(self.measures(one))] for one in self.people)
        header = ("person", *GaitMeasures.__struct_fields__)
        write_csv(folder / "measures.csv", header, rows)
        angles = [
            row
            for one in self.people
            if (motion := self.motion(one))
            for row in angle_rows(one, motion, self.steps(one))
        ]
        write_csv(folder / "joint_angles.csv", ANGLE_FIELDS, angles)

    def _step_cells(self) -> Iterator[Sequence[object]]:
        for person in self.people:
            for step in self.steps(person):
                stride = (step.stride.length_m, step.stride.time_s) if step.stride else ("", "")
                row = (person, step.foot, step.landed_s, step.length_m, *stride)
                yield *row, step.confidence, int(step.observed)


def _cells(row: _Row) -> Sequence[object]:
    point = row.point
    sigma_m = np.sqrt(np.maximum(np.diag(point.covariance)[:3], 0.0))
    numbers = (*point.position_m, *point.velocity_mps, *sigma_m, point.confidence)
    return (row.time_s, row.person, point.name, point.state, *map(float, numbers))
