"""Durations of the stages of a frame, and their sum against the end-to-end latency.

The end-to-end time is from the camera's stamp to a subscriber's clock, independent of the stages.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from benchmarks.lib.system.bare import INFERENCE
from benchmarks.lib.table import markdown
from common.runtime.latency import merge_stages, percentiles
from common.runtime.monitor import FramePath

ALL = "all but inference"
HEADER = ("mean ms", "p50 ms", "p95 ms", "p99 ms")


def stage_tables(paths: Sequence[FramePath], end_to_end_ms: Sequence[float]) -> list[str]:
    """Return the stages in the order of the path, by kind, and their sum, as tables."""
    found: dict[tuple[str, bool], list[float]] = defaultdict(list)
    for path in sorted(paths, key=lambda path: -len(path.parts)):  # order of the longest path
        for pieces, is_parallel in ((path.parts, False), (path.parallel, True)):
            for part in merge_stages(pieces):
                found[part.name, is_parallel].append(part.ms)
    rows = []
    for (name, is_parallel), values in sorted(found.items(), key=lambda item: item[0][1]):
        share = "parallel" if is_parallel else _share(values, end_to_end_ms)
        rows.append([*_row(name, values, len(paths)), share])
    return [
        markdown(("stage", *HEADER, "of the whole"), rows),
        markdown(("over all processes", *HEADER), _kinds(paths)),
        _sums(paths, end_to_end_ms),
    ]


def _kinds(paths: Iterable[FramePath]) -> list[list[str]]:
    """Return all stages except inference, by kind over all processes, longest first."""
    found: dict[str, list[float]] = defaultdict(list)
    for path in paths:
        sums: dict[str, float] = defaultdict(float)
        for part in path.parts:
            if part.stage not in INFERENCE:
                sums[ALL] += part.ms
                sums[part.stage] += part.ms
        for stage, ms in sums.items():
            found[stage].append(ms)
    longest = sorted(found.items(), key=lambda item: -float(np.mean(item[1])))
    return [_row(name, values, len(values)) for name, values in longest]


def _sums(paths: Sequence[FramePath], end_to_end_ms: Sequence[float]) -> str:
    """Return the sum of the stages and the end-to-end time."""
    named = [sum(p.ms for p in path.parts if p.stage != "other") for path in paths]
    sums: Mapping[str, Sequence[float]] = {
        "from the camera's stamp to the subscriber": end_to_end_ms,
        "sum of the stages with a name": named,
        "with `other`, the work between them": [sum(p.ms for p in x.parts) for x in paths],
    }
    rows = [
        [name, f"{np.mean(values):.3f}", _share(values, end_to_end_ms)]
        for name, values in sums.items()
    ]
    worst = max(abs(1 - a / b) for a, b in zip(named, end_to_end_ms, strict=True))
    table = markdown(("mean over frames", "ms", "of the first"), rows)
    return f"{table}\n\nThe worst single frame is {worst:.1%} off."


def _row(name: str, values: Sequence[float], frames: int) -> list[str]:
    return [name, *(f"{ms:.2f}" for ms in (sum(values) / frames, *percentiles(values)))]


def _share(values: Sequence[float], end_to_end_ms: Sequence[float]) -> str:
    return f"{np.sum(values) / np.sum(end_to_end_ms):.1%}"
