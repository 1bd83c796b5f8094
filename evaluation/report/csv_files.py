"""Metrics as CSV files: the same bytes for the same recordings and methods."""

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from evaluation.report.tables import ReportTable, RunGroup
from evaluation.run.run import RunOutput, RunScores
from people4d.errors import SourceError

SWITCH_FIELDS = ("method", "recording", "person", "before", "after", "last_s", "at_s")


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table.

    Raises:
        SourceError: The file cannot be written.
    """
    file = io.StringIO(newline="")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_text(value) for value in row] for row in rows)
    write_bytes(path, file.getvalue().encode())


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file, its folder first.

    Raises:
        SourceError: It cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise SourceError(f"{path} cannot be written: {error.strerror}") from error


def write_runs(
    path: Path, scores: Sequence[RunScores], rows: Sequence[Mapping[str, float | None]]
) -> None:
    """Write one line for each run with all its metrics."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    header = ["method", "recording", "scenario", "seed", "people_in_truth", *names]
    write_csv(
        path,
        header,
        (
            [
                r.method,
                r.recording.name,
                r.recording.scenario,
                r.recording.seed,
                r.people,
                *map(row.get, names),
            ]
            for r, row in zip(scores, rows, strict=True)
        ),
    )


def write_summary(path: Path, groups: Sequence[RunGroup]) -> None:
    """Write one line for each metric of each group of runs."""
    write_csv(
        path,
        ["method", "people", "metric", "mean", "std", "least", "most", "runs"],
        (
            [g.method, g.people, name, s.mean, s.std, s.least, s.most, s.runs]
            for g in groups
            for name, s in g.metrics.items()
            if s is not None
        ),
    )


def write_table(folder: Path, table: ReportTable) -> None:
    """Write a table of the report as it is shown there."""
    header = ["method", "source", "people", *(column.title for column in table.columns)]
    rows = (
        [line.method, "published" if line.published else "measured", line.people, *line.cells]
        for line in table.rows
    )
    write_csv(folder / f"{table.name}.csv", header, rows)


def switch_rows(method: str, recording: str, output: RunOutput) -> list[tuple[object, ...]]:
    """Return one row for each ID switch, see SWITCH_FIELDS."""
    stamps_s = output.matching.sequence.stamps_s
    return [
        (method, recording, s.person, s.before, s.after, stamps_s[s.last_frame], stamps_s[s.frame])
        for s in output.matching.id_switches
    ]


def _text(value: object) -> object:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.6g}"
    return "" if value is None else value
