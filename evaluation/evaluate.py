"""All methods on all takes: judged, summarised, drawn and written."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from common.metrics import Row, combine
from evaluation.pool import Pool
from evaluation.recordings.recordings import EvaluationRecording
from evaluation.report.csv_files import (
    SWITCH_FIELDS,
    switch_rows,
    write_bytes,
    write_csv,
    write_runs,
    write_summary,
    write_table,
)
from evaluation.report.filmstrips import Filmstrip, filmstrips_of
from evaluation.report.page import ReportContent, ReportFigure, html_of
from evaluation.report.tables import (
    OVERVIEW,
    SHAPES,
    SPEED,
    ReportTable,
    fill,
    groups_of,
    row_of,
    speed_of,
)
from evaluation.report.trajectories import RunTrajectories, trajectories_of
from evaluation.run.preparation import (
    EvaluationPlan,
    OnProgress,
    WorkQueue,
    check_models,
    render_all,
    runs_of,
)
from evaluation.run.run import EvaluationRun, RunScores, run, score_run


@dataclass(frozen=True)
class RunReport:
    """One trial.

    Args:
        result: Its figures.
        switches: One row for each ID switch, see `output.SWITCH_FIELDS`.
        strips: Pictures of the first of them, if wanted.
        trace: Its course, if wanted.
    """

    result: RunScores
    switches: tuple[tuple[object, ...], ...]
    strips: tuple[Filmstrip, ...] = ()
    trace: RunTrajectories | None = None


@dataclass(frozen=True)
class Evaluation:
    """All trials, method by method.

    Args:
        judged: One for each method and take.
        rows: Figures of each.
        overview: The most telling figures.
        tables: All of the report.
        pictures: Of the first take of each scenario, and of the errors.
    """

    judged: tuple[RunReport, ...]
    rows: tuple[Row, ...]
    overview: ReportTable
    tables: tuple[ReportTable, ...]
    pictures: tuple[ReportFigure, ...]


def evaluate(plan: EvaluationPlan, report: OnProgress) -> Evaluation:
    """Judge all methods on all takes.

    Args:
        plan: What is evaluated.
        report: Called with what is being done and the share of it that is done.

    Raises:
        SourceError: A recording cannot be read, or has no truth.
        ModelError: A model is absent.
    """
    check_models(plan)
    render_all(plan, report)
    with Pool(plan.jobs) as pool:
        work = WorkQueue(pool, report)
        shown = _shown(plan.takes)
        tries = [(trial, trial.take.name in shown) for trial in runs_of(plan, work)]
        judged = work.do("tracking", try_out, tries)
        pictures = _pictures(plan, judged, work) if plan.figures else ()
    results = [one.result for one in judged]
    rows = [row_of(result) for result in results]
    groups = groups_of(results, rows)
    tables = [fill(shape, groups) for shape in SHAPES]
    if any(result.pipeline_ms for result in results):
        speeds = groups_of(results, [speed_of(result) for result in results])
        tables.insert(4, fill(SPEED, speeds))
    overview = fill(OVERVIEW, groups, spread=False)
    return Evaluation(tuple(judged), tuple(rows), overview, tuple(tables), pictures)


def write(plan: EvaluationPlan, evaluation: Evaluation, folder: Path, command: str) -> Path:
    """Write all figures as CSV files, pictures, and the report that holds everything.

    Args:
        plan: What was evaluated.
        evaluation: What came of it.
        folder: Made if it is not there.
        command: With which it is made again.

    Returns:
        The report.

    Raises:
        SourceError: The folder cannot be written.
    """
    judged = evaluation.judged
    results = [one.result for one in judged]
    switches = [row for one in judged for row in one.switches]
    strips = [strip for one in judged for strip in one.strips]
    write_runs(folder / "runs.csv", results, evaluation.rows)
    write_summary(folder / "summary.csv", groups_of(results, evaluation.rows))
    write_csv(folder / "switches.csv", SWITCH_FIELDS, switches)
    for table in evaluation.tables:
        write_table(folder / "tables", table)
    for picture in evaluation.pictures:
        write_bytes(folder / "figures" / f"{picture.name}.png", picture.png)
    for number, strip in enumerate(strips, 1):
        name = f"{number:03d}_{strip.method}_{strip.take}.png"
        write_bytes(folder / "switches" / name, strip.png())
    content = ReportContent(
        command=command,
        results=results,
        tables=evaluation.tables,
        pictures=evaluation.pictures,
        strips=strips,
        switches=len(switches),
        settings={method.name: method.text() for method in plan.methods},
    )
    report = folder / "report.html"
    write_bytes(report, html_of(content).encode())
    return report


def try_out(asked: tuple[EvaluationRun, bool]) -> RunReport:
    """Do one trial.

    Args:
        asked: The trial, and whether its course and its ID switches are shown.
    """
    trial, shown = asked
    done = run(trial)
    rows = tuple(switch_rows(trial.method.name, trial.take.name, done))
    if not shown:
        return RunReport(score_run(trial, done), rows)
    course = trajectories_of(trial.method.name, done)
    return RunReport(score_run(trial, done), rows, filmstrips_of(trial, done), course)


def draw(
    asked: tuple[EvaluationRecording, tuple[RunTrajectories, ...]],
) -> tuple[ReportFigure, ...]:
    """Draw the courses of all methods on one take."""
    from evaluation.report import figures  # noqa: PLC0415 (matplotlib may not be there)

    take, traces = asked
    plans, courses = figures.floor_plans(take.name, traces), figures.courses(take.name, traces)
    return (
        ReportFigure(f"{take.name}_floor", f"{take.name}: trajectories on the floor", plans),
        ReportFigure(f"{take.name}_time", f"{take.name}: position, velocity and yaw", courses),
    )


def _shown(takes: Sequence[EvaluationRecording]) -> set[str]:
    """Return the names of the takes that are shown: the first of each scenario."""
    first = {take.scenario: take.name for take in reversed(takes)}
    return set(first.values())


def _pictures(
    plan: EvaluationPlan, judged: Sequence[RunReport], work: WorkQueue
) -> tuple[ReportFigure, ...]:
    from evaluation.report import figures  # noqa: PLC0415

    asked = []
    for take in plan.takes:
        traces = tuple(j.trace for j in judged if j.trace and j.result.take.name == take.name)
        if any(len(trace.stamps_s) and trace.persons for trace in traces):
            asked.append((take, traces))
    pooled = {
        method.name: combine(j.result.scores for j in judged if j.result.method == method.name)
        for method in plan.methods
    }
    errors = ReportFigure("errors", "Errors over all recordings", figures.histograms(pooled))
    drawn = work.do("drawing", draw, asked)
    return (errors, *(picture for pictures in drawn for picture in pictures))
