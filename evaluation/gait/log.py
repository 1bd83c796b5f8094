"""What was told of people, frame by frame, and the tables made of it."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evaluation.report.csv_files import write_csv
from people4d.messages import F64, BodyPoint, GaitMeasures
from services.gait.people import UP, Found
from services.gait.points.points import LEFT_FOOT, RIGHT_FOOT
from services.gait.steps.config import StepConfig
from services.gait.steps.steps import Path as FootPath
from services.gait.steps.steps import Step, find_steps, measures_of

POINT_FIELDS = (
    *("time_s", "person", "point", "state", "x_m", "y_m", "z_m", "vx_mps", "vy_mps", "vz_mps"),
    *("sigma_x_m", "sigma_y_m", "sigma_z_m", "confidence"),
)
STEP_FIELDS = ("person", "foot", "landed_s", "step_length_m", "stride_length_m", "stride_s")
MEASURES = GaitMeasures.__struct_fields__


@dataclass(frozen=True)
class Trail:
    """One point of one person over time: N samples.

    Args:
        times_s: N.
        positions_m: Nx3.
        measured: N, whether it was seen.
    """

    times_s: F64
    positions_m: F64
    measured: np.ndarray


@dataclass(frozen=True)
class _Row:
    time_s: float
    person: int
    point: BodyPoint


class Log:
    """Keeps what was told.

    Args:
        config: What counts as a step.
    """

    def __init__(self, config: StepConfig) -> None:
        self._config = config
        self._rows: list[_Row] = []
        self._start_ns: int | None = None

    def add(self, stamp_ns: int, found: Sequence[Found]) -> float:
        """Take a frame and return the seconds since the first one."""
        self._start_ns = stamp_ns if self._start_ns is None else self._start_ns
        time_s = (stamp_ns - self._start_ns) / 1e9
        self._rows += [_Row(time_s, one.person.id, p) for one in found for p in one.person.points]
        return time_s

    @property
    def people(self) -> tuple[int, ...]:
        """Whose points were told."""
        return tuple(sorted({row.person for row in self._rows}))

    def trails(self, person: int) -> Mapping[str, Trail]:
        """Return the points of a person by name; where one was lost it has no sample."""
        rows: dict[str, list[_Row]] = defaultdict(list)
        for row in self._rows:
            if row.person == person and row.point.state != "lost":
                rows[row.point.name].append(row)
        return {
            name: Trail(
                np.array([row.time_s for row in found]),
                np.array([row.point.position_m for row in found]),
                np.array([row.point.state == "measured" for row in found]),
            )
            for name, found in rows.items()
        }

    def steps(self, person: int) -> list[Step]:
        """Return all steps of a person."""
        trails = self.trails(person)
        if LEFT_FOOT not in trails or RIGHT_FOOT not in trails:
            return []
        left, right = (
            FootPath(trail.times_s[trail.measured], trail.positions_m[trail.measured])
            for trail in (trails[LEFT_FOOT], trails[RIGHT_FOOT])
        )
        return find_steps(left, right, UP, self._config)

    def measures(self, person: int) -> GaitMeasures:
        """Return how a person walked, over all steps."""
        return measures_of(self.steps(person), self._config)

    def write(self, folder: Path) -> None:
        """Write gait.csv, steps.csv and measures.csv.

        Raises:
            SourceError: A file cannot be written.
        """
        write_csv(folder / "gait.csv", POINT_FIELDS, (_cells(row) for row in self._rows))
        write_csv(folder / "steps.csv", STEP_FIELDS, self._step_cells())
        told = ((person, self.measures(person)) for person in self.people)
        rows = ([person, *(getattr(found, name) for name in MEASURES)] for person, found in told)
        write_csv(folder / "measures.csv", ("person", *MEASURES), rows)

    def _step_cells(self) -> Iterator[Sequence[object]]:
        for person in self.people:
            for step in self.steps(person):
                stride = (step.stride.length_m, step.stride.time_s) if step.stride else ("", "")
                yield person, step.foot, step.landed_s, step.length_m, *stride


def _cells(row: _Row) -> Sequence[object]:
    point = row.point
    sigma_m = np.sqrt(np.maximum(np.diag(point.covariance)[:3], 0.0))
    numbers = (*point.position_m, *point.velocity_mps, *sigma_m, point.confidence)
    return (row.time_s, row.person, point.name, point.state, *map(float, numbers))
