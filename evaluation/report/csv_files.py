"""Metrics as CSV files: the same bytes for the same recordings and methods."""

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from evaluation.report.tables import ReportTable, RunGroup
from evaluation.run.run import RunOutput, RunScores
from people4d.errors import SourceError

SwitchRow = tuple[object, ...]  # see the header in `write_switches`


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table; SourceError if the file cannot be written."""
    file = io.StringIO(newline="")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_text(value) for value in row] for row in rows)
    write_bytes(path, file.getvalue().encode())


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file, and create its folder; SourceError if it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise SourceError(f"{path} cannot be written: {error.strerror}") from error


def write_runs(
    path: Path, scores: Sequence[RunScores], rows: Sequence[Mapping[str, float | None]]
) -> None:
    """Write one line with all metrics for each run."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    header = ["method", "recording", "scenario", "seed", "people_in_truth", *names]
    lines = []
    for result, row in zip(scores, rows, strict=True):
        recording = result.recording
        run = [result.method, recording.name, recording.scenario, recording.seed, result.people]
        lines.append([*run, *map(row.get, names)])
    write_csv(path, header, lines)


def write_summary(path: Path, groups: Sequence[RunGroup]) -> None:
    """Write one line for each metric of each group of runs."""
    header = ["method", "people", "metric", "mean", "std", "least", "most", "runs"]
    lines = (
        [g.method, g.people, name, s.mean, s.std, s.least, s.most, s.runs]
        for g in groups
        for name, s in g.metrics.items()
        if s is not None
    )
    write_csv(path, header, lines)


def write_table(path: Path, table: ReportTable) -> None:
    """Write a table of the report as shown on the page."""
    header = ["method", "source", "people", *(column.title for column in table.columns)]
    rows = (
        [line.method, "published" if line.published else "measured", line.people, *line.cells]
        for line in table.rows
    )
    write_csv(path, header, rows)


def write_switches(path: Path, rows: Iterable[SwitchRow]) -> None:
    """Write one line for each ID switch."""
    header = ("method", "recording", "person", "before", "after", "last_s", "at_s")
    write_csv(path, header, rows)


def switch_rows(method: str, recording: str, output: RunOutput) -> tuple[SwitchRow, ...]:
    """Return one row for each ID switch of a run."""
    stamps_s = output.matching.sequence.stamps_s
    return tuple(
        (method, recording, s.person, s.before, s.after, stamps_s[s.last_frame], stamps_s[s.frame])
        for s in output.matching.id_switches
    )


def _text(value: object) -> object:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.6g}"
    return "" if value is None else value
