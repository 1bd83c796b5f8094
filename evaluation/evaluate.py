"""Evaluation of all methods on all recordings: scores, tables, figures and images."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from common.metrics.scores import Row, combine
from evaluation.pool import OnProgress, Pool
from evaluation.protocol import RecordingProtocol, recording_protocol
from evaluation.report.csv_files import SwitchRow, switch_rows
from evaluation.report.parts import part_sums
from evaluation.report.switch_images import SwitchImage, switch_images
from evaluation.report.tables import ReportTable, fill, groups_of, rate_of, read_tables, row_of
from evaluation.report.trajectories import RunTrajectories, trajectories_of
from evaluation.run.preparation import EvaluationPlan, check_models, render_all, runs_of
from evaluation.run.run import EvaluationRun, RunScores, execute, score_run
from people4d.messages import F64


@dataclass(frozen=True, kw_only=True)
class RunReport:
    """Results of one run."""

    scores: RunScores
    switches: tuple[SwitchRow, ...]  # one row for each ID switch
    # Images of the first switches; empty unless the recording is shown
    images: tuple[SwitchImage, ...] = ()
    trajectories: RunTrajectories | None = None  # trajectories; None unless the recording is shown
    parts: F64  # sums of each part, see `part_sums`
    truth: RecordingProtocol  # ground truth of the run


@dataclass(frozen=True)
class ReportFigure:
    """A figure of the report."""

    name: str  # name of its file, without the ending
    title: str
    png: bytes  # content of the file


@dataclass(frozen=True)
class Evaluation:
    """All runs, method by method."""

    runs: tuple[RunReport, ...]  # runs, one for each method and recording
    rows: tuple[Row, ...]  # metrics of each run
    overview: ReportTable  # the most important metrics
    tables: tuple[ReportTable, ...]  # all tables of the report
    figures: tuple[ReportFigure, ...]  # first recording of each scenario, and errors

    @property
    def switches(self) -> list[SwitchRow]:
        """One row for each ID switch of all runs."""
        return [row for run in self.runs for row in run.switches]


def evaluate(plan: EvaluationPlan, on_progress: OnProgress) -> Evaluation:
    """Score all methods on all recordings; SourceError for a recording, ModelError for a model."""
    check_models(plan)
    render_all(plan, on_progress)
    with Pool(plan.jobs, on_progress) as pool:
        # The first recording of each scenario is shown.
        first = {recording.scenario: recording.name for recording in reversed(plan.recordings)}
        wanted = [(run, run.recording.name in first.values()) for run in runs_of(plan, pool)]
        runs = pool.do("tracking", _run, wanted)
        figures = _figures(plan, runs, pool) if plan.figures else ()
    scores = [run.scores for run in runs]
    rows = [row_of(one) for one in scores]
    tables = read_tables()
    overview, rates = tables.pop("overview"), tables["6_5_speed"]
    groups = groups_of(scores, rows)
    filled = {name: fill(table, groups) for name, table in tables.items()}
    if any(one.pipeline_ms for one in scores):
        filled[rates.name] = fill(rates, groups_of(scores, [rate_of(one) for one in scores]))
    else:
        del filled[rates.name]
    overview = fill(overview, groups, spread=False)
    return Evaluation(tuple(runs), tuple(rows), overview, tuple(filled.values()), figures)


def _run(wanted: tuple[EvaluationRun, bool]) -> RunReport:
    """Execute one run; the flag is True if its trajectories and ID switches are shown."""
    run, shown = wanted
    output = execute(run)
    report = RunReport(
        scores=score_run(run, output),
        switches=switch_rows(run.method.name, run.recording.name, output),
        parts=part_sums(output.matching),
        truth=recording_protocol(run.recording, run.truth),
    )
    if not shown:
        return report
    trajectories = trajectories_of(run.method.name, output)
    return replace(report, images=switch_images(run, output), trajectories=trajectories)


def _draw(wanted: tuple[str, list[RunTrajectories]]) -> tuple[ReportFigure, ...]:
    """Draw the trajectories of all methods on one recording."""
    from evaluation.report import figures  # noqa: PLC0415 (matplotlib may be absent)

    name, trajectories = wanted
    floor = figures.floor_plans(name, trajectories)
    time = figures.time_series(name, trajectories)
    return (
        ReportFigure(f"{name}_floor", f"{name}: trajectories on the floor", floor),
        ReportFigure(f"{name}_time", f"{name}: position, velocity and yaw", time),
    )


def _figures(
    plan: EvaluationPlan, runs: Sequence[RunReport], pool: Pool
) -> tuple[ReportFigure, ...]:
    from evaluation.report import figures  # noqa: PLC0415 (matplotlib may be absent)

    shown: dict[str, list[RunTrajectories]] = {}
    for run in runs:
        if run.trajectories:
            shown.setdefault(run.scores.recording.name, []).append(run.trajectories)
    wanted = [
        (name, trajectories)
        for name, trajectories in shown.items()
        if any(len(one.stamps_s) and one.persons for one in trajectories)
    ]
    pooled = {
        method.name: combine(r.scores.scores for r in runs if r.scores.method == method.name)
        for method in plan.methods
    }
    errors = ReportFigure("errors", "Errors over all recordings", figures.histograms(pooled))
    drawn = pool.do("drawing", _draw, wanted)
    return (errors, *(figure for drawing in drawn for figure in drawing))
