"""Figures of all trials as tables: mean and spread by number of people, beside the paper's own."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from common.metrics import Row, SummaryStatistics, summarise
from evaluation.report.published import PUBLISHED
from evaluation.run.run import RunScores

PARTS = ("measured", "predicted", "occluded")  # of the poses, apart


@dataclass(frozen=True)
class TableColumn:
    """One figure.

    Args:
        figure: Its name.
        title: In the head of the table.
        digits: Behind the point.
        factor: 100 for percent.
    """

    figure: str
    title: str
    digits: int
    factor: float = 1.0

    def text(self, value: SummaryStatistics | float | None, spread: bool = True) -> str:
        """Return a figure, or its mean and, if wanted, its spread as text."""
        if value is None:
            return "-"
        if not isinstance(value, SummaryStatistics):
            return f"{value * self.factor:.{self.digits}f}"
        mean, std = (f"{v * self.factor:.{self.digits}f}" for v in (value.mean, value.std))
        return f"{mean} ± {std}" if spread and value.runs > 1 else mean


@dataclass(frozen=True)
class TableRow:
    """One row of a table.

    Args:
        method: What was judged.
        people: Number of people, "all" for all recordings.
        cells: One for each column, as text.
        paper: Whether the figures are the paper's own.
    """

    method: str
    people: str
    cells: tuple[str, ...]
    paper: bool = False


@dataclass(frozen=True)
class ReportTable:
    """One table of the report.

    Args:
        name: Short, for a file.
        title: Above it.
        columns: Figures.
        lines: Rows, the paper's last.
    """

    name: str
    title: str
    columns: tuple[TableColumn, ...]
    lines: tuple[TableRow, ...] = field(default=())


@dataclass(frozen=True)
class RunGroup:
    """A method's trials with one number of people, or all."""

    method: str
    people: str
    figures: dict[str, SummaryStatistics | None]


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
SHAPES = (
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
            TableColumn("yaw_reported", "yaw told (%)", 1, 100),
        ),
    ),
    ReportTable(
        "tracking",
        "Tracking: how long, how completely, how purely",
        (
            TableColumn("coverage", "coverage (%)", 1, 100),
            TableColumn("coverage_measured", "measured (%)", 1, 100),
            TableColumn("mean_segment_s", "mean segment (s)", 1),
            TableColumn("mean_first_track_s", "first track after (s)", 2),
            TableColumn("share_reidentified", "returned known (%)", 1, 100),
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
                "Only people in view whom the tracker saw in that frame",
                "Only people in view whom the tracker predicted",
                "Only people hidden by others (in no other table)",
            ),
            strict=True,
        )
    ),
)
SPEED = ReportTable(
    "6_5_speed",
    "Table 6.5: frames per second of the whole pipeline, on the machine that made the detections",
    (TableColumn("rate_hz", "FPS", 1),),
)


def row_of(result: RunScores) -> Row:
    """Return all figures of a trial that are the same on any machine."""
    scores, row = result.scores, result.scores.row()
    for part in PARTS:
        poses = getattr(scores, f"pose_{part}").row()
        row |= {f"{part}_{name}": value for name, value in poses.items()}
    return row


def speed_of(result: RunScores) -> Row:
    """Return what a trial tells about speed."""
    rate_hz = 1000.0 / result.pipeline_ms if result.pipeline_ms else None
    return {"pipeline_ms": result.pipeline_ms, "rate_hz": rate_hz}


def groups_of(results: Sequence[RunScores], rows: Sequence[Row]) -> list[RunGroup]:
    """Summarise each method over all its trials and by number of people.

    Args:
        results: The trials.
        rows: Figures of each.
    """
    methods = dict.fromkeys(result.method for result in results)
    counts = sorted({result.people for result in results})
    groups = []
    for method in methods:
        for people in (None, *counts):
            chosen = [
                row
                for result, row in zip(results, rows, strict=True)
                if result.method == method and people in (None, result.people)
            ]
            if chosen:
                groups.append(
                    RunGroup(method, "all" if people is None else str(people), summarise(chosen))
                )
    return groups


def fill(shape: ReportTable, groups: Sequence[RunGroup], spread: bool = True) -> ReportTable:
    """Return a table with its rows: ours, then those that the paper has.

    Args:
        shape: Its columns.
        groups: What its rows are about.
        spread: Whether the spread is told beside the mean.
    """
    lines = [
        TableRow(
            group.method,
            group.people,
            tuple(c.text(group.figures.get(c.figure), spread) for c in shape.columns),
        )
        for group in groups
    ]
    return ReportTable(shape.name, shape.title, shape.columns, (*lines, *_paper_lines(shape)))


def _paper_lines(shape: ReportTable) -> Iterator[TableRow]:
    for reported in PUBLISHED:
        for people, figures in (("all", reported.figures), *reported.by_people.items()):
            told = [figures.get(column.figure) for column in shape.columns]
            # By number of people the paper gives few figures: only rows that are whole.
            if all(v is not None for v in told) or (people == "all" and any(told)):
                cells = tuple(c.text(v) for c, v in zip(shape.columns, told, strict=True))
                yield TableRow(f"paper: {reported.method}", str(people), cells, paper=True)
