"""The summary in words, for the terminal, the text file and the contact sheet."""

from collections.abc import Sequence

from services.report.statistics import END_TO_END, Percentiles, RunSummary

NONE = "none"
INFERENCE = "detector.inference"
# Stages in which a message waits, wholly or partly, so they do not limit the rate
WAITING = {
    *("capture", "release", "transport", "queue", "wait", "inference_wait", "wake"),
    *("publish", "other"),
}


def headline(summary: RunSummary) -> str:
    """Return the summary in one line."""
    words = f"{summary.frames_tracked} of {summary.frames} frames tracked, {summary.tracks} tracks"
    latency = latency_of(summary)
    return f"{words}, latency {latency.p50_ms:.0f} ms" if latency else words


def latency_of(summary: RunSummary) -> Percentiles | None:
    """Return the end-to-end latency; None in lock-step, since frames wait for each other."""
    return None if summary.lockstep else summary.latency.get(END_TO_END)


def multiple_of_inference(summary: RunSummary) -> float | None:
    """Return the median end-to-end latency in medians of the detector's inference."""
    total, inference = latency_of(summary), summary.latency.get(INFERENCE)
    return total.p50_ms / inference.p50_ms if total and inference and inference.p50_ms else None


def slowest_stage(summary: RunSummary) -> tuple[str, float] | None:
    """Return the working stage with the longest median, and the rate that it allows [Hz]."""
    medians_ms = {
        name: stage.p50_ms
        for name, stage in summary.latency.items()
        if name != END_TO_END and name.rpartition(".")[2] not in WAITING and stage.p50_ms > 0
    }
    name = max(medians_ms, key=medians_ms.__getitem__, default="")
    return (name, 1000 / medians_ms[name]) if name else None


def facts(summary: RunSummary) -> list[tuple[str, str]]:
    """Return the statistics: pairs of a name and a sentence."""
    return [
        ("frames", _frames(summary)),
        ("people", _people(summary)),
        ("tracks", _tracks(summary)),
        ("truth", _score(summary)),
        *_latency(summary),
        *_drops(summary),
        *(("degraded", reason) for reason in summary.degraded),
        ("not used", ", ".join(summary.unused) or NONE),
        *([("missing", ", ".join(summary.missing))] if summary.missing else []),
    ]


def latency_table(summary: RunSummary) -> list[tuple[str, str, str, str]]:
    """Return the latency as a table with a head; empty if there are no measurements."""
    if not summary.latency:
        return []
    rows = [
        (name, f"{p.p50_ms:.1f}", f"{p.p95_ms:.1f}", f"{p.p99_ms:.1f}")
        for name, p in summary.latency.items()
    ]
    name = "latency in ms, in lock-step" if summary.lockstep else "latency in ms"
    return [(name, "p50", "p95", "p99"), *rows]


def text(summary: RunSummary) -> str:
    """Return the complete summary as plain text."""
    lines = [f"{name:<10} {sentence}" for name, sentence in facts(summary)]
    table = latency_table(summary)
    width = max((len(row[0]) for row in table), default=0)
    lines += ["" for _ in table[:1]]
    lines += [f"{name:<{width}} {a:>8} {b:>8} {c:>8}" for name, a, b, c in table]
    return "\n".join(lines) + "\n"


def _frames(s: RunSummary) -> str:
    parts = [f"{s.frames} in, {s.frames_detected} detected, {s.frames_tracked} tracked"]
    parts += [f"recorded at {s.recorded_hz:.1f} Hz"] if s.recorded_hz else []
    parts += [f"processed at {s.processed_hz:.1f} Hz"] if s.processed_hz else []
    return ", ".join(parts)


def _people(s: RunSummary) -> str:
    if s.people_per_frame is None:
        return NONE
    parts = [f"{s.people} detected by {s.model}", f"{s.people_per_frame:.2f} a frame"]
    if s.position_share is not None:
        parts.append(f"{s.position_share:.1%} with a 3D position")
    return ", ".join(parts)


def _tracks(s: RunSummary) -> str:
    if s.track_length_mean is None or s.track_length_median is None:
        return NONE
    return (
        f"{s.tracks} by {s.tracker}, length mean {s.track_length_mean:.1f}, "
        f"median {s.track_length_median:.1f} frames"
    )


def _score(s: RunSummary) -> str:
    if s.score is None:
        return NONE
    parts = [f"{s.score.matched} of {s.score.truths} people matched"]
    if s.position_error_median_m is not None:
        median_m, rmse_m = s.position_error_median_m, s.score.position_rmse_m
        parts.append(f"position median {median_m:.3f} m RMSE {rmse_m:.3f} m")
    if s.score.velocity_rmse_mps is not None:
        parts.append(f"velocity RMSE {s.score.velocity_rmse_mps:.2f} m/s")
    switches = f"{s.score.id_switches} ID switches"
    return ", ".join([*parts, switches, f"{s.score.false_alarms} false alarms"])


def _latency(s: RunSummary) -> Sequence[tuple[str, str]]:
    latency = latency_of(s)
    if latency is None:
        return []
    return [("latency", f"median {latency.p50_ms:.1f} ms, p95 {latency.p95_ms:.1f} ms, end to end")]


def _drops(s: RunSummary) -> Sequence[tuple[str, str]]:
    if not s.drops:
        return [("drops", NONE)]
    return [
        ("drops", f"{instance}: {', '.join(f'{cause} {n}' for cause, n in causes.items())}")
        for instance, causes in s.drops.items()
    ]
