"""Methods on all sequences of a data set: a table of figures and the files of its server."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from pathlib import Path

from common.metrics.scores import Row
from evaluation.datasets.dataset import Dataset, DatasetJob, SequenceResult
from evaluation.methods import Method
from evaluation.pool import OnProgress, Pool
from evaluation.report.csv_files import write_bytes, write_csv
from people4d.errors import SourceError

POOLED = "all"  # name of all sequences with truth together
LineOfScores = tuple[str, str, Row]  # method, sequence, figures


@dataclass(frozen=True)
class DatasetPlan:
    """Methods to be run on a data set."""

    dataset: Dataset
    folder: Path
    methods: Sequence[Method]
    out: Path  # folder of the results
    cache: Path
    jobs: int = 1  # number of processes, without effect on the result


def evaluate_dataset(plan: DatasetPlan, on_progress: OnProgress) -> list[LineOfScores]:
    """Run all methods on all sequences; write `scores.csv` and `submission/METHOD/...`.

    SourceError if the folder lacks a file, or a file has another layout.
    """
    plan.dataset.require(plan.folder)
    names = plan.dataset.sequences(plan.folder)
    if not names:
        raise SourceError(f"{plan.folder}: expected sequences, got none", plan.dataset.obtain)
    jobs = [
        (plan.dataset, DatasetJob(plan.folder, name, method, plan.cache))
        for method in plan.methods
        for name in names
    ]
    with Pool(plan.jobs, on_progress) as pool:
        results = pool.do("tracking", _evaluate, jobs)
    lines: list[LineOfScores] = []
    for start, method in zip(range(0, len(jobs), len(names)), plan.methods, strict=True):
        own = results[start : start + len(names)]
        files: dict[str, str] = {}  # several sequences may share a file
        for result in own:
            for path, text in result.submission.items():
                files[path] = files.get(path, "") + text
        for path, text in files.items():
            write_bytes(plan.out / "submission" / method.name / path, text.encode())
        scored = [(n, r.figures) for n, r in zip(names, own, strict=True) if r.figures is not None]
        lines += [(method.name, name, figures.row()) for name, figures in scored]
        if len(scored) > 1:
            pooled = reduce(add, (figures for _, figures in scored))
            lines.append((method.name, POOLED, pooled.row()))
    columns = list(dict.fromkeys(name for _, _, row in lines for name in row))
    cells = [[method, name, *map(row.get, columns)] for method, name, row in lines]
    write_csv(plan.out / "scores.csv", ["method", "sequence", *columns], cells)
    return lines


def _evaluate(job: tuple[Dataset, DatasetJob]) -> SequenceResult:
    dataset, one = job
    return dataset.evaluate(one)
