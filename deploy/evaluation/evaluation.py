"""All methods on all takes: films what is missing, finds people once, tracks, and judges."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import msgspec

from common.messages import Detections
from common.metrics import Row
from common.recording import open_recording
from deploy.evaluation.detections import Look, Seen, look
from deploy.evaluation.methods import Method
from deploy.evaluation.output import (
    SWITCH_FIELDS,
    switch_rows,
    write_csv,
    write_runs,
    write_summary,
    write_table,
)
from deploy.evaluation.pool import do_all
from deploy.evaluation.tables import (
    OVERVIEW,
    SHAPES,
    SPEED,
    Table,
    fill,
    groups_of,
    row_of,
    speed_of,
)
from deploy.evaluation.takes import Take, film
from deploy.evaluation.trial import Result, Trial, judge, run
from deploy.evaluation.truth import Happening, read_truth

A = TypeVar("A")
B = TypeVar("B")
Report = Callable[[str, float], object]


@dataclass(frozen=True)
class Plan:
    """What is evaluated.

    Args:
        methods: What is judged, each under a name of its own.
        takes: What it is judged on.
        cache: Folder of films and detections, which are made once.
        jobs: Processes at once; the result does not depend on it.
    """

    methods: tuple[Method, ...]
    takes: tuple[Take, ...]
    cache: Path
    jobs: int = 1


@dataclass(frozen=True)
class Judged:
    """One trial.

    Args:
        result: Its figures.
        switches: One row for each ID switch, see `output.SWITCH_FIELDS`.
    """

    result: Result
    switches: tuple[tuple[object, ...], ...]


@dataclass(frozen=True)
class Evaluation:
    """All trials, method by method.

    Args:
        judged: One for each method and take.
        rows: Figures of each.
        overview: The most telling figures.
        tables: All of the report.
    """

    judged: tuple[Judged, ...]
    rows: tuple[Row, ...]
    overview: Table
    tables: tuple[Table, ...]


def evaluate(plan: Plan, report: Report) -> Evaluation:
    """Judge all methods on all takes.

    Args:
        plan: What is evaluated.
        report: Called with what is being done and the share of it that is done.

    Raises:
        SourceError: A recording cannot be read, or has no truth.
        ModelError: A model is absent.
    """
    for take in plan.takes:
        film(take, plan.jobs, partial(_filming, report, take.name))
    trials = _trials(plan, report)
    judged = _done(plan, try_out, trials, "tracking", report)
    results = [one.result for one in judged]
    rows = [row_of(result) for result in results]
    groups = groups_of(results, rows)
    tables = [fill(shape, groups) for shape in SHAPES]
    if any(result.pipeline_ms for result in results):
        speeds = groups_of(results, [speed_of(result) for result in results])
        tables.insert(4, fill(SPEED, speeds))
    overview = fill(OVERVIEW, groups, spread=False)
    return Evaluation(tuple(judged), tuple(rows), overview, tuple(tables))


def write(evaluation: Evaluation, folder: Path) -> None:
    """Write all figures as CSV files.

    Raises:
        SourceError: The folder cannot be written.
    """
    results = [one.result for one in evaluation.judged]
    write_runs(folder / "runs.csv", results, evaluation.rows)
    write_summary(folder / "summary.csv", groups_of(results, evaluation.rows))
    switches = (row for one in evaluation.judged for row in one.switches)
    write_csv(folder / "switches.csv", SWITCH_FIELDS, switches)
    for table in evaluation.tables:
        write_table(folder / "tables", table)


def try_out(trial: Trial) -> Judged:
    """Do one trial."""
    done = run(trial)
    rows = switch_rows(trial.method.name, trial.take.name, done)
    return Judged(judge(trial, done), tuple(rows))


def _trials(plan: Plan, report: Report) -> list[Trial]:
    """Find the people of every take once for each way to see them, and what is true."""
    looks: dict[tuple[str, bytes], Look] = {}
    for take in plan.takes:
        for method in plan.methods:
            _ask(looks, take, method, plan.cache)
    seen = dict(
        zip(looks, _done(plan, look, list(looks.values()), "detecting", report), strict=True)
    )
    asked: dict[tuple[str, bytes], tuple[Take, Path]] = {}
    for take in plan.takes:
        for method in plan.methods:
            found = seen[_way(take, method)].detections
            asked.setdefault((take.name, _key(method.camera)), (take, found))
    told = dict(zip(asked, _done(plan, _truth, list(asked.values()), "truth", report), strict=True))
    trials = []
    for method in plan.methods:
        for take in plan.takes:
            way = _way(take, method)
            vectors = _embeddings(looks[way], seen[way], method)
            truth = told[take.name, _key(method.camera)]
            trials.append(Trial(method, take, seen[way].detections, vectors, truth))
    return trials


def _filming(report: Report, name: str, what: str, share: float) -> None:
    report(f"{what} {name}", share)


def _ask(looks: dict[tuple[str, bytes], Look], take: Take, method: Method, cache: Path) -> None:
    way = _way(take, method)
    wanted = looks.get(way) or Look(take.path, method.camera, method.detector, (), cache)
    if method.reid and method.reid not in wanted.reids:
        wanted = Look(
            take.path, method.camera, method.detector, (*wanted.reids, method.reid), cache
        )
    looks[way] = wanted


def _embeddings(wanted: Look, seen: Seen, method: Method) -> Path | None:
    return seen.embeddings[wanted.reids.index(method.reid)] if method.reid else None


def _truth(asked: tuple[Take, Path]) -> Happening:
    take, detections = asked
    found = open_recording(detections).messages(Detections)
    return read_truth(take, [message.stamp_ns for _, message in found])


def _way(take: Take, method: Method) -> tuple[str, bytes]:
    """Return what tells one way to see one take from any other."""
    return take.name, _key(method.camera) + _key(method.detector)


def _key(record: msgspec.Struct) -> bytes:
    return msgspec.json.encode(record)


def _done(
    plan: Plan, work: Callable[[A], B], items: Sequence[A], what: str, report: Report
) -> list[B]:
    finished: list[int] = []

    def done(index: int) -> None:
        finished.append(index)
        report(what, len(finished) / len(items))

    report(what, 0.0)
    return do_all(work, items, plan.jobs, done)
