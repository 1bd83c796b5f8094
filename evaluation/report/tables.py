"""Metrics of all runs as tables: mean and standard deviation, with published results.

The columns are in tables.toml. The published results (published.csv, by our names of metrics) are
reference points, measured elsewhere on other data: Intel NUC 11 (i5-1135G7), seven recordings of
about one minute with 2 to 4 people in 3.5 x 5.5 m, motion capture as truth. Its x axis runs across
the view of the camera, its y axis along it.
"""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from common.metrics.scores import Row, SummaryStatistics, summarise
from evaluation.run.run import RunScores

SOURCE = "published: other recordings, of real people, Intel NUC 11"


class TableColumn(msgspec.Struct, frozen=True, array_like=True):
    """Column of one metric."""

    metric: str
    title: str  # heading of the column
    digits: int  # number of decimals
    factor: float = 1.0  # 100 for percent

    def text(self, value: SummaryStatistics | float | None, spread: bool = True) -> str:
        """Return a value, or its mean and, if wanted, its standard deviation as text."""
        if value is None:
            return "-"
        if not isinstance(value, SummaryStatistics):
            return f"{value * self.factor:.{self.digits}f}"
        mean, std = (f"{v * self.factor:.{self.digits}f}" for v in (value.mean, value.std))
        return f"{mean} ± {std}" if spread and value.runs > 1 else mean


@dataclass(frozen=True)
class TableRow:
    """One row of a table."""

    method: str
    people: str  # number of people, or "all"
    cells: tuple[str, ...]  # one for each column, as text
    published: bool = False


class ReportTable(msgspec.Struct, frozen=True):
    """One table of the report."""

    name: str  # short, for a file
    title: str
    columns: tuple[TableColumn, ...]
    rows: tuple[TableRow, ...] = ()  # published results last


@dataclass(frozen=True)
class RunGroup:
    """A method's runs with one number of people, or all."""

    method: str
    people: str
    metrics: dict[str, SummaryStatistics | None]


def read_tables() -> dict[str, ReportTable]:
    """Return the tables without rows, by name: the overview, then the page's tables in order."""
    text = Path(__file__).with_name("tables.toml").read_bytes()
    tables = msgspec.toml.decode(text, type=dict[str, tuple[ReportTable, ...]])["tables"]
    return {table.name: table for table in tables}


def row_of(result: RunScores) -> Row:
    """Return all metrics of a run except the processing rate."""
    scores, row = result.scores, result.scores.row()
    for part, poses in scores.pose_parts.items():
        row |= {f"{part}_{name}": value for name, value in poses.row().items()}
    return row


def rate_of(result: RunScores) -> Row:
    """Return the processing rate of a run."""
    rate_hz = 1000.0 / result.pipeline_ms if result.pipeline_ms else None
    return {"pipeline_ms": result.pipeline_ms, "rate_hz": rate_hz}


def groups_of(scores: Sequence[RunScores], rows: Sequence[Row]) -> list[RunGroup]:
    """Summarise the rows of each method over all its runs and by number of people."""
    groups: dict[tuple[str, int], list[Row]] = {}
    counts = sorted({result.people for result in scores})
    for method in dict.fromkeys(result.method for result in scores):
        groups |= {(method, people): [] for people in (-1, *counts)}
    for result, row in zip(scores, rows, strict=True):
        groups[result.method, -1].append(row)
        groups[result.method, result.people].append(row)
    return [
        RunGroup(method, "all" if people < 0 else str(people), summarise(chosen))
        for (method, people), chosen in groups.items()
        if chosen
    ]


def fill(table: ReportTable, groups: Sequence[RunGroup], spread: bool = True) -> ReportTable:
    """Return a table with the rows of groups, then published results.

    Means have their standard deviation if `spread` is set.
    """
    rows = [
        TableRow(
            group.method,
            group.people,
            tuple(c.text(group.metrics.get(c.metric), spread) for c in table.columns),
        )
        for group in groups
    ]
    return msgspec.structs.replace(table, rows=(*rows, *_published_rows(table)))


def _published_rows(table: ReportTable) -> Iterator[TableRow]:
    with Path(__file__).with_name("published.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            texts = [row.get(column.metric) for column in table.columns]
            # Few metrics are published by number of people: only complete rows are shown.
            if all(texts) or (row["people"] == "all" and any(texts)):
                values = [float(text) if text else None for text in texts]
                cells = tuple(c.text(v) for c, v in zip(table.columns, values, strict=True))
                method = f"published: {row['method']}"
                yield TableRow(method, row["people"], cells, published=True)
