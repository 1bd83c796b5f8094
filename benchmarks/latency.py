"""Durations of the stages of a frame, and their sum against the end-to-end latency.

A live camera sends at 60 % of the rate that the pipeline can hold, so that queues are empty. The
end-to-end time is from the camera's stamp to a subscriber's clock, independent of the stages.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.system.playback import INFERENCE, Playback, live, lockstep, play
from benchmarks.lib.table import markdown, write
from common.runtime.latency import merge_stages, percentiles
from common.runtime.monitor import FramePath

RATE_SHARE = 0.6
LIMITS_MS = (8.0, 15.0)  # [ms] wanted p50 and p99 of all stages but inference


def stage_table(paths: Sequence[FramePath]) -> str:
    """Return the durations of all stages in the order of the path, and their share of the whole."""
    found: dict[tuple[str, bool], list[float]] = defaultdict(list)
    for path in sorted(paths, key=lambda path: -len(path.parts)):  # order of the longest path
        for pieces, beside in ((path.parts, False), (path.beside, True)):
            for part in merge_stages(pieces):
                found[part.name, beside].append(part.ms)
    total_ms = sum(path.end_to_end.ms for path in paths)
    rows = [
        [
            name,
            f"{np.sum(values) / len(paths):.2f}",
            *(f"{ms:.2f}" for ms in percentiles(values)),
            "beside the path" if beside else f"{np.sum(values) / total_ms:.1%}",
        ]
        for (name, beside), values in sorted(found.items(), key=lambda item: item[0][1])
    ]
    return markdown(["stage", "mean ms", "p50 ms", "p95 ms", "p99 ms", "of the whole"], rows)


def kinds_table(paths: Sequence[FramePath]) -> str:
    """Return all stages except inference, by kind over all processes, longest first."""
    found: dict[str, list[float]] = defaultdict(list)
    for path in paths:
        sums: dict[str, float] = defaultdict(float)
        for part in path.parts:
            if part.stage not in INFERENCE:
                sums["all but inference"] += part.ms
                sums[part.stage] += part.ms
        for stage, ms in sums.items():
            found[stage].append(ms)
    longest = sorted(found.items(), key=lambda item: -float(np.mean(item[1])))
    rows = [
        [stage, *(f"{ms:.2f}" for ms in (np.mean(values), *percentiles(values)))]
        for stage, values in longest
    ]
    return markdown(["over all processes", "mean ms", "p50 ms", "p95 ms", "p99 ms"], rows)


def sums_table(run: Playback) -> str:
    """Return the sum of the stages and the end-to-end time."""
    named = [sum(p.ms for p in path.parts if p.stage != "other") for path in run.paths]
    every = [sum(p.ms for p in path.parts) for path in run.paths]
    end_to_end = run.end_to_end_ms
    worst = max(abs(1 - a / b) for a, b in zip(named, end_to_end, strict=True))
    rows = [
        ["from the camera's stamp to the subscriber", f"{np.mean(end_to_end):.3f}", "100 %"],
        ["sum of the stages with a name", f"{np.mean(named):.3f}", _share(named, end_to_end)],
        ["with `other`, the work between them", f"{np.mean(every):.3f}", _share(every, end_to_end)],
    ]
    table = markdown(["mean over frames", "ms", "of the first"], rows)
    return f"{table}\n\nThe worst single frame is {worst:.1%} off."


def _share(part: Sequence[float], end_to_end: Sequence[float]) -> str:
    return f"{np.mean(part) / np.mean(end_to_end):.2%}"


def main() -> None:
    """Measure and write the tables."""
    parser = options.parser(__doc__)
    parser.add_argument("--frames", type=int, default=200, help="frames of the lock-step run")
    frames = parser.parse_args().frames
    rate_hz = RATE_SHARE * play(lockstep(frames), frames).rate_hz
    run = play(live(rate_hz), 2 * frames)
    write(
        __file__,
        "Latency: time of a frame by stage",
        "Camera, detector (MoveNet), re-ID and tracker as processes, 640x480, three people, one "
        "network thread, a subscriber through the router. Stages are explained in "
        "[docs/operation/latency.md](../docs/operation/latency.md).",
        f"## Stages at {RATE_SHARE:.0%} load, {run.rate_hz:.1f} frames per second",
        stage_table(run.paths),
        "## All stages but inference",
        f"Wanted: p50 at most {LIMITS_MS[0]:g} ms, p99 at most {LIMITS_MS[1]:g} ms.",
        kinds_table(run.paths),
        "## Sum of the stages against the end-to-end time",
        sums_table(run),
    )
