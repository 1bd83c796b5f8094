"""Evaluation of all methods on all recordings: scores, tables, figures and the report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from common.metrics import Row, combine
from evaluation.pool import Pool
from evaluation.recordings.recordings import EvaluationRecording, OnProgress
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
    RATES,
    TABLES,
    ReportTable,
    fill,
    groups_of,
    rate_of,
    row_of,
)
from evaluation.report.trajectories import RunTrajectories, trajectories_of
from evaluation.run.preparation import EvaluationPlan, WorkQueue, check_models, render_all, runs_of
from evaluation.run.run import EvaluationRun, RunScores, execute, score_run


@dataclass(frozen=True)
class RunReport:
    """Results of one run."""

    scores: RunScores
    # one row for each ID switch, see `csv_files.SWITCH_FIELDS`
    switches: tuple[tuple[object, ...], ...]
    filmstrips: tuple[Filmstrip, ...] = ()  # images of the first of them, if the recording is shown
    # paths of people and tracks, if the recording is shown
    trajectories: RunTrajectories | None = None


@dataclass(frozen=True)
class Evaluation:
    """All runs, method by method."""

    runs: tuple[RunReport, ...]  # one for each method and recording
    rows: tuple[Row, ...]  # metrics of each
    overview: ReportTable  # the most important metrics
    tables: tuple[ReportTable, ...]  # all tables of the report
    figures: tuple[ReportFigure, ...]  # of the first recording of each scenario, and of the errors


def evaluate(plan: EvaluationPlan, on_progress: OnProgress) -> Evaluation:
    """Score all methods on all recordings.

    Args:
        plan: Methods and recordings.
        on_progress: Called with the name of the stage and the share of it that is done.

    Raises:
        SourceError: A recording cannot be read, or has no truth.
        ModelError: A model is absent.
    """
    check_models(plan)
    render_all(plan, on_progress)
    with Pool(plan.jobs) as pool:
        work = WorkQueue(pool, on_progress)
        shown = _shown(plan.recordings)
        wanted = [(run, run.recording.name in shown) for run in runs_of(plan, work)]
        runs = work.do("tracking", _run, wanted)
        figures = _figures(plan, runs, work) if plan.figures else ()
    scores = [run.scores for run in runs]
    rows = [row_of(one) for one in scores]
    groups = groups_of(scores, rows)
    tables = [fill(table, groups) for table in TABLES]
    if any(one.pipeline_ms for one in scores):
        rates = groups_of(scores, [rate_of(one) for one in scores])
        tables.insert(4, fill(RATES, rates))
    overview = fill(OVERVIEW, groups, spread=False)
    return Evaluation(tuple(runs), tuple(rows), overview, tuple(tables), figures)


def write(plan: EvaluationPlan, evaluation: Evaluation, folder: Path, command: str) -> Path:
    """Write all metrics as CSV files, images, and the report that contains everything.

    Args:
        plan: Methods and recordings.
        evaluation: Its results.
        folder: Folder of the files; it is made if it is absent.
        command: Command that makes them again.

    Returns:
        The report.

    Raises:
        SourceError: The folder cannot be written.
    """
    scores = [run.scores for run in evaluation.runs]
    switches = [row for run in evaluation.runs for row in run.switches]
    filmstrips = [filmstrip for run in evaluation.runs for filmstrip in run.filmstrips]
    write_runs(folder / "runs.csv", scores, evaluation.rows)
    write_summary(folder / "summary.csv", groups_of(scores, evaluation.rows))
    write_csv(folder / "switches.csv", SWITCH_FIELDS, switches)
    for table in evaluation.tables:
        write_table(folder / "tables", table)
    for figure in evaluation.figures:
        write_bytes(folder / "figures" / f"{figure.name}.png", figure.png)
    for number, filmstrip in enumerate(filmstrips, 1):
        name = f"{number:03d}_{filmstrip.method}_{filmstrip.recording}.png"
        write_bytes(folder / "switches" / name, filmstrip.png())
    content = ReportContent(
        command=command,
        scores=scores,
        tables=evaluation.tables,
        figures=evaluation.figures,
        filmstrips=filmstrips,
        switches=len(switches),
        settings={method.name: method.text() for method in plan.methods},
    )
    report = folder / "report.html"
    write_bytes(report, html_of(content).encode())
    return report


def _run(wanted: tuple[EvaluationRun, bool]) -> RunReport:
    """Do one run; the flag tells that its trajectories and ID switches are shown."""
    run, shown = wanted
    output = execute(run)
    rows = tuple(switch_rows(run.method.name, run.recording.name, output))
    if not shown:
        return RunReport(score_run(run, output), rows)
    trajectories = trajectories_of(run.method.name, output)
    return RunReport(score_run(run, output), rows, filmstrips_of(run, output), trajectories)


def _draw(wanted: tuple[str, tuple[RunTrajectories, ...]]) -> tuple[ReportFigure, ...]:
    """Draw the trajectories of all methods on one recording."""
    from evaluation.report import figures  # noqa: PLC0415 (matplotlib may be absent)

    name, trajectories = wanted
    floor = figures.floor_plans(name, trajectories)
    time = figures.time_series(name, trajectories)
    return (
        ReportFigure(f"{name}_floor", f"{name}: trajectories on the floor", floor),
        ReportFigure(f"{name}_time", f"{name}: position, velocity and yaw", time),
    )


def _shown(recordings: Sequence[EvaluationRecording]) -> set[str]:
    """Return the names of the recordings that are shown: the first of each scenario."""
    first = {recording.scenario: recording.name for recording in reversed(recordings)}
    return set(first.values())


def _figures(
    plan: EvaluationPlan, runs: Sequence[RunReport], work: WorkQueue
) -> tuple[ReportFigure, ...]:
    from evaluation.report import figures  # noqa: PLC0415 (matplotlib may be absent)

    wanted = []
    for recording in plan.recordings:
        name = recording.name
        shown = [r.trajectories for r in runs if r.scores.recording.name == name]
        trajectories = tuple(one for one in shown if one is not None)
        if any(len(one.stamps_s) and one.persons for one in trajectories):
            wanted.append((name, trajectories))
    pooled = {
        method.name: combine(r.scores.scores for r in runs if r.scores.method == method.name)
        for method in plan.methods
    }
    errors = ReportFigure("errors", "Errors over all recordings", figures.histograms(pooled))
    drawn = work.do("drawing", _draw, wanted)
    return (errors, *(figure for drawing in drawn for figure in drawing))
