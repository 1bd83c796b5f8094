"""Durations of the stages of a frame, their sum against end-to-end latency, cost of tracing.

Stages: a live camera at 60 % of the rate that the pipeline can hold, so that queues are empty; the
end-to-end time is from the camera's own stamp to a subscriber's clock, neither of which the stages
know. Cost of tracing: of the marks themselves, measured alone, and of the whole pipeline in
lock-step with tracing on and off, by turns.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.system.playback import INFERENCE, Playback, live, lockstep, play
from benchmarks.lib.system.tracing_cost import cost_of_marks, tracing
from benchmarks.lib.table import markdown, spread, write
from common.runtime.latency import merge_stages, percentiles
from common.runtime.monitor import FramePath
from common.transport.trace import STAGES

RATE_SHARE = 0.6
LIMITS_MS = (8.0, 15.0)  # wanted of all that is not inference, at p50 and p99


def stage_table(paths: Sequence[FramePath]) -> str:
    """Return the durations of all stages in the order of the path, and their share of the whole."""
    found: dict[tuple[str, bool], list[float]] = defaultdict(list)
    for path in sorted(paths, key=lambda path: -len(path.parts)):  # the fullest tells the order
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
    """Return what is not inference, by kind of stage over all processes, dearest first."""
    found: dict[str, list[float]] = defaultdict(list)
    for path in paths:
        sums: dict[str, float] = defaultdict(float)
        for part in path.parts:
            if part.stage not in INFERENCE:
                sums["all but inference"] += part.ms
                sums[part.stage] += part.ms
        for stage, ms in sums.items():
            found[stage].append(ms)
    dearest = sorted(found.items(), key=lambda item: -float(np.mean(item[1])))
    rows = [
        [stage, *(f"{ms:.2f}" for ms in (np.mean(values), *percentiles(values))), _meaning(stage)]
        for stage, values in dearest
    ]
    return markdown(["over all processes", "mean ms", "p50 ms", "p95 ms", "p99 ms", ""], rows)


def _meaning(stage: str) -> str:
    if stage == "all but inference":
        return f"wanted: p50 <= {LIMITS_MS[0]:g}, p99 <= {LIMITS_MS[1]:g}"
    return STAGES.get(stage, "").removeprefix("* ")


def sums_table(run: Playback) -> str:
    """Return how much of the end-to-end time the stages explain."""
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


def cost_table(pairs: Sequence[tuple[Playback, Playback]]) -> str:
    """Return what the pipeline does with tracing on and off.

    Args:
        pairs: Runs with tracing on and off.
    """
    rates = [(on.rate_hz, off.rate_hz) for on, off in pairs]
    cpus = [(on.cpu_ms, off.cpu_ms) for on, off in pairs]
    rows = [
        ["frames per second, lock-step", *_row(rates, "{:.1f}", lambda on, off: off / on - 1)],
        ["processor ms for a frame", *_row(cpus, "{:.2f}", lambda on, off: on / off - 1)],
    ]
    return markdown(["", "on", "off", "cost of tracing, pair by pair"], rows)


def _row(
    pairs: Sequence[tuple[float, float]], form: str, cost: Callable[[float, float], float]
) -> list[str]:
    costs = [cost(*pair) for pair in pairs]
    return [
        spread([on for on, _ in pairs], form),
        spread([off for _, off in pairs], form),
        spread(costs, "{:+.1%}"),
    ]


def main() -> None:
    """Measure all three."""
    parser = options.parser(__doc__, "quick")
    parser.add_argument("--rounds", type=int, default=6, help="pairs with tracing on and off")
    parser.add_argument("--frames", type=int, default=200, help="of one run")
    flags = parser.parse_args()
    rounds, frames = (1, 40) if flags.quick else (flags.rounds, flags.frames)
    pairs = []
    for number in range(rounds):
        print(f"tracing on and off: round {number + 1} of {rounds}", flush=True)
        order = (True, False) if number % 2 == 0 else (False, True)
        found = {}
        for on in order:
            with tracing(on):
                found[on] = play(lockstep(frames), frames)
        pairs.append((found[True], found[False]))
    rate_hz = RATE_SHARE * float(np.median([on.rate_hz for on, _ in pairs]))
    print(f"stages at {rate_hz:.1f} frames per second", flush=True)
    run = play(live(rate_hz), 2 * frames)
    longest = max((path.tracks.trace for path in run.paths), key=len)
    marks = cost_of_marks(longest, 20 * frames)
    values = list(marks.values())
    added_us = values[0] - values[1] + values[2] - values[3]
    cpu_ms = float(np.median([off.cpu_ms for _, off in pairs]))
    write(
        __file__,
        "Latency: where the time of a frame goes, and what measuring it costs",
        "Camera, detector (MoveNet), re-ID and tracker as processes, 640x480, three people, one "
        "network thread, a subscriber through the router. Stages are explained in "
        "[docs/operation/latency.md](../docs/operation/latency.md).",
        f"## Stages at {RATE_SHARE:.0%} load, {run.rate_hz:.1f} frames per second",
        stage_table(run.paths),
        "## What is not inference",
        kinds_table(run.paths),
        "## Sum of the stages against the end-to-end time",
        sums_table(run),
        "## Cost of tracing",
        markdown(
            ["the marks of one frame, alone in one thread", "us"],
            [[name, f"{us:.0f}"] for name, us in marks.items()]
            + [["added by tracing", f"{added_us:.0f}"]],
        ),
        f"That is {added_us / cpu_ms / 10:.2f} % of the {cpu_ms:.1f} ms of processor time that a "
        "frame takes without tracing. The same in the whole pipeline, where noise is larger:",
        cost_table(pairs),
    )
