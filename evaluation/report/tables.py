"""Metrics of all runs as tables: mean and standard deviation, beside published results."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from common.metrics import Row, SummaryStatistics, summarise
from evaluation.report.published import PUBLISHED
from evaluation.run.run import RunScores

PARTS = ("measured", "predicted", "occluded")  # of the poses, apart


@dataclass(frozen=True)
class TableColumn:
    """One metric."""

    metric: str
    title: str  # heading of the column
    digits: int  # decimals
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
    people: str  # number of people, "all" for all recordings
    cells: tuple[str, ...]  # one for each column, as text
    published: bool = False  # True for published results


@dataclass(frozen=True)
class ReportTable:
    """One table of the report."""

    name: str  # short, for a file
    title: str
    columns: tuple[TableColumn, ...]
    rows: tuple[TableRow, ...] = field(default=())  # rows, published results last


@dataclass(frozen=True)
class RunGroup:
    """A method's runs with one number of people, or all."""

    method: str
    people: str
    metrics: dict[str, SummaryStatistics | None]


def _within(name: str, unit: str, limits: Sequence[float]) -> Iterator[TableColumn]:
    shown = {"m": "m", "mps": "m/s", "deg": "°"}[unit]
    for limit in limits:
        yield TableColumn(f"{name}_within_{limit}_{unit}", f"within {limit} {shown} (%)", 1, 100)


OVERVIEW = ReportTable(
    "overview",
    "Means over recordings; across and along the camera's axis",
    (
        TableColumn("id_switches_per_min", "switches a min", 2),
        TableColumn("position_rmse_across_m", "across m", 3),
        TableColumn("position_rmse_along_m", "along m", 3),
        TableColumn("velocity_rmse_across_mps", "across m/s", 3),
        TableColumn("velocity_rmse_along_mps", "along m/s", 3),
        TableColumn("yaw_rmse_deg", "yaw °", 1),
        TableColumn("yaw_correlation", "yaw corr", 3),
        TableColumn("coverage", "covered %", 1, 100),
    ),
)
TABLES = (
    ReportTable(
        "6_1_id_switches",
        "Table 6.1: ID switches a minute",
        (TableColumn("id_switches_per_min", "ID switches/min", 2),),
    ),
    ReportTable(
        "6_2_position",
        "Table 6.2: position",
        (
            TableColumn("position_rmse_across_m", "RMSE across (m)", 3),
            TableColumn("position_rmse_along_m", "RMSE along (m)", 3),
            *_within("position", "m", (0.15, 0.3, 0.5)),
        ),
    ),
    ReportTable(
        "6_3_velocity",
        "Table 6.3: velocity",
        (
            TableColumn("velocity_rmse_across_mps", "RMSE across (m/s)", 3),
            TableColumn("velocity_rmse_along_mps", "RMSE along (m/s)", 3),
            *_within("velocity", "mps", (0.15, 0.3, 0.5)),
        ),
    ),
    ReportTable(
        "6_4_orientation",
        "Table 6.4: orientation",
        (
            TableColumn("yaw_rmse_deg", "RMSE (°)", 1),
            TableColumn("yaw_correlation", "correlation", 3),
            *_within("yaw", "deg", (30, 45, 90)),
            TableColumn("yaw_reported", "yaw reported (%)", 1, 100),
        ),
    ),
    ReportTable(
        "tracking",
        "Tracking: duration, completeness, purity",
        (
            TableColumn("coverage", "coverage (%)", 1, 100),
            TableColumn("coverage_measured", "measured (%)", 1, 100),
            TableColumn("mean_segment_s", "mean segment (s)", 1),
            TableColumn("mean_first_track_s", "first track after (s)", 2),
            TableColumn("share_reidentified", "re-identified (%)", 1, 100),
            TableColumn("mota", "MOTA (%)", 1, 100),
            TableColumn("idf1", "IDF1 (%)", 1, 100),
            TableColumn("hota", "HOTA (%)", 1, 100),
            TableColumn("precision", "precision (%)", 1, 100),
        ),
    ),
    *(
        ReportTable(
            f"apart_{part}",
            title,
            (
                TableColumn(f"{part}_poses", "poses", 0),
                TableColumn(f"{part}_position_rmse_across_m", "position across (m)", 3),
                TableColumn(f"{part}_position_rmse_along_m", "along (m)", 3),
                TableColumn(f"{part}_velocity_rmse_across_mps", "velocity across (m/s)", 3),
                TableColumn(f"{part}_velocity_rmse_along_mps", "along (m/s)", 3),
                TableColumn(f"{part}_yaw_rmse_deg", "yaw (°)", 1),
            ),
        )
        for part, title in zip(
            PARTS,
            (
                "Only people in view with a measurement in that frame",
                "Only people in view whom the tracker predicted",
                "Only people occluded by others (in no other table)",
            ),
            strict=True,
        )
    ),
)
RATES = ReportTable(
    "6_5_speed",
    "Table 6.5: frames per second of the pipeline, on the machine that made the detections",
    (TableColumn("rate_hz", "FPS", 1),),
)


def row_of(result: RunScores) -> Row:
    """Return all metrics of a run that are the same on any machine."""
    scores, row = result.scores, result.scores.row()
    for part in PARTS:
        poses = getattr(scores, f"pose_{part}").row()
        row |= {f"{part}_{name}": value for name, value in poses.items()}
    return row


def rate_of(result: RunScores) -> Row:
    """Return the processing rate of a run."""
    rate_hz = 1000.0 / result.pipeline_ms if result.pipeline_ms else None
    return {"pipeline_ms": result.pipeline_ms, "rate_hz": rate_hz}


def groups_of(scores: Sequence[RunScores], rows: Sequence[Row]) -> list[RunGroup]:
    """Summarise each method over all its runs and by number of people.

    Args:
        scores: The runs.
        rows: Metrics of each.
    """
    methods = dict.fromkeys(result.method for result in scores)
    counts = sorted({result.people for result in scores})
    groups = []
    for method in methods:
        for people in (None, *counts):
            chosen = [
                row
                for result, row in zip(scores, rows, strict=True)
                if result.method == method and people in (None, result.people)
            ]
            if chosen:
                groups.append(
                    RunGroup(method, "all" if people is None else str(people), summarise(chosen))
                )
    return groups


def fill(table: ReportTable, groups: Sequence[RunGroup], spread: bool = True) -> ReportTable:
    """Return a table with its rows: those of groups, then published results.

    Args:
        table: Its columns.
        groups: Groups of runs, one for each row.
        spread: True: show the standard deviation beside the mean.
    """
    rows = [
        TableRow(
            group.method,
            group.people,
            tuple(c.text(group.metrics.get(c.metric), spread) for c in table.columns),
        )
        for group in groups
    ]
    return ReportTable(table.name, table.title, table.columns, (*rows, *_published_rows(table)))


def _published_rows(table: ReportTable) -> Iterator[TableRow]:
    for reported in PUBLISHED:
        for people, metrics in (("all", reported.metrics), *reported.by_people.items()):
            values = [metrics.get(column.metric) for column in table.columns]
            # By number of people few metrics are published: only complete rows are shown.
            if all(v is not None for v in values) or (people == "all" and any(values)):
                cells = tuple(c.text(v) for c, v in zip(table.columns, values, strict=True))
                yield TableRow(f"published: {reported.method}", str(people), cells, published=True)
