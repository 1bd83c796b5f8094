"""All methods on all takes: films what is missing, finds people once, tracks, and judges."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import msgspec

from common.messages import Detections
from common.metrics import Row, combine
from common.recording import open_recording
from deploy.evaluation.detections import Look, Seen, look
from deploy.evaluation.methods import Method
from deploy.evaluation.output import (
    SWITCH_FIELDS,
    switch_rows,
    write_bytes,
    write_csv,
    write_runs,
    write_summary,
    write_table,
)
from deploy.evaluation.page import Content, Picture, html_of
from deploy.evaluation.pool import Pool
from deploy.evaluation.strips import Strip, strips_of
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
from deploy.evaluation.trace import Trace, trace_of
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
        figures: Whether figures are drawn, which takes matplotlib.
    """

    methods: tuple[Method, ...]
    takes: tuple[Take, ...]
    cache: Path
    jobs: int = 1
    figures: bool = True


@dataclass(frozen=True)
class Judged:
    """One trial.

    Args:
        result: Its figures.
        switches: One row for each ID switch, see `output.SWITCH_FIELDS`.
        strips: Pictures of the first of them, if wanted.
        trace: Its course, if wanted.
    """

    result: Result
    switches: tuple[tuple[object, ...], ...]
    strips: tuple[Strip, ...] = ()
    trace: Trace | None = None


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

    judged: tuple[Judged, ...]
    rows: tuple[Row, ...]
    overview: Table
    tables: tuple[Table, ...]
    pictures: tuple[Picture, ...]


@dataclass(frozen=True)
class Work:
    """Does pieces of work and tells how far it is.

    Args:
        pool: Where they are done.
        report: Called with what is being done and the share of it that is done.
    """

    pool: Pool
    report: Report

    def do(self, what: str, work: Callable[[A], B], items: Sequence[A]) -> list[B]:
        """Return the results of all pieces, in their order."""
        finished: list[int] = []

        def done(index: int) -> None:
            finished.append(index)
            self.report(what, len(finished) / len(items))

        self.report(what, 0.0)
        return self.pool.do_all(work, items, done)


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
    with Pool(plan.jobs) as pool:
        work = Work(pool, report)
        shown = _shown(plan.takes)
        tries = [(trial, trial.take.name in shown) for trial in _trials(plan, work)]
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


def write(plan: Plan, evaluation: Evaluation, folder: Path, command: str) -> Path:
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
    content = Content(
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


def try_out(asked: tuple[Trial, bool]) -> Judged:
    """Do one trial.

    Args:
        asked: The trial, and whether its course and its ID switches are shown.
    """
    trial, shown = asked
    done = run(trial)
    rows = tuple(switch_rows(trial.method.name, trial.take.name, done))
    if not shown:
        return Judged(judge(trial, done), rows)
    course = trace_of(trial.method.name, done)
    return Judged(judge(trial, done), rows, strips_of(trial, done), course)


def draw(asked: tuple[Take, tuple[Trace, ...]]) -> tuple[Picture, ...]:
    """Draw the courses of all methods on one take."""
    from deploy.evaluation import figures  # noqa: PLC0415 (matplotlib may not be there)

    take, traces = asked
    plans, courses = figures.floor_plans(take.name, traces), figures.courses(take.name, traces)
    return (
        Picture(f"{take.name}_floor", f"{take.name}: trajectories on the floor", plans),
        Picture(f"{take.name}_time", f"{take.name}: position, velocity and yaw", courses),
    )


def _shown(takes: Sequence[Take]) -> set[str]:
    """Return the names of the takes that are shown: the first of each scenario."""
    first = {take.scenario: take.name for take in reversed(takes)}
    return set(first.values())


def _pictures(plan: Plan, judged: Sequence[Judged], work: Work) -> tuple[Picture, ...]:
    from deploy.evaluation import figures  # noqa: PLC0415

    asked = []
    for take in plan.takes:
        traces = tuple(j.trace for j in judged if j.trace and j.result.take.name == take.name)
        if any(len(trace.stamps_s) and trace.persons for trace in traces):
            asked.append((take, traces))
    pooled = {
        method.name: combine(j.result.scores for j in judged if j.result.method == method.name)
        for method in plan.methods
    }
    errors = Picture("errors", "Errors over all recordings", figures.histograms(pooled))
    drawn = work.do("drawing", draw, asked)
    return (errors, *(picture for pictures in drawn for picture in pictures))


def _trials(plan: Plan, work: Work) -> list[Trial]:
    """Find the people of every take once for each way to see them, and what is true."""
    looks: dict[tuple[str, bytes], Look] = {}
    for take in plan.takes:
        for method in plan.methods:
            _ask(looks, take, method, plan.cache)
    seen = dict(zip(looks, work.do("detecting", look, list(looks.values())), strict=True))
    asked: dict[tuple[str, bytes], tuple[Take, Path]] = {}
    for take in plan.takes:
        for method in plan.methods:
            found = seen[_way(take, method)].detections
            asked.setdefault((take.name, _key(method.camera)), (take, found))
    told = dict(zip(asked, work.do("truth", _truth, list(asked.values())), strict=True))
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
