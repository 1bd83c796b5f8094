"""3D tracking from a robot that drives, with its odometry and without, and from one that stands.

The six scenarios of [Park 2021] in the virtual lab: first with detections from geometry, without
appearance, so that only the motion differs; then four, rendered, with the whole pipeline. "stands":
the same people before a robot that does not drive. "no odometry": the robot drives, and odometry
reports that it stands.
"""

import math
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.lib import options
from benchmarks.lib.table import markdown, spread, write
from common.io.recording import RecordingWriter, open_recording
from common.metrics.matching import Matching
from common.metrics.scores import score_matching
from deploy.cli.terminal import progress
from evaluation.cache import default_folder
from evaluation.methods import Method, read_method
from evaluation.pool import Pool
from evaluation.recordings.recordings import EvaluationRecording, plan_recordings
from evaluation.run.preparation import EvaluationPlan, render_all, runs_of
from evaluation.run.run import execute
from lab.output.sequence import Fidelity
from people4d.messages import F64, Message, Odometry

SCENARIOS = ("psrm", "pmrr", "pmrm1", "pmrm2", "port1", "port2")
FOLDER = Path(__file__).parents[1] / "lab" / "scenarios"
RENDERED = ("psrm", "pmrr", "pmrm1", "pmrm2")  # fastest to render
SMALL = "width = 320\nheight = 240\nfocal_px = 307.5\n"  # half of the scenarios' size
STANDING_MPS = 0.05  # [m/s] speed below which a person stands
WALKING_MPS = 0.3  # [m/s] speed from which a person walks
HEADER = [
    *("scenario", "robot", "standing people: speed p50 m/s", "p95 m/s"),
    *("walking people: velocity RMSE m/s", "position RMSE m"),
    *("measured m", "ID switches a min", "covered %"),
]


@dataclass(frozen=True)
class Case:
    """One scenario with one motion of the robot."""

    scenario: str
    name: str
    recordings: Sequence[EvaluationRecording]


def main() -> None:
    """Track, score and write the tables."""
    parser = options.parser(__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[73, 74, 75])
    parser.add_argument(
        "--rendered-seeds",
        type=int,
        nargs="*",
        default=[73],
        help="Each takes half an hour of one core.",
    )
    arguments = parser.parse_args()
    method = read_method("best")
    geometry = _table(method, SCENARIOS, arguments.seeds, "geometry")
    rendered = _table(method, RENDERED, arguments.rendered_seeds, "colour")
    parts = [
        f"Preset best, seeds {', '.join(map(str, arguments.seeds))}; median "
        "over seeds with minimum and maximum. Positions are relative to the camera "
        "(docs/methods/evaluation.md); `measured`: of tracks with a detection in the frame.",
        "## Detections from geometry, without appearance",
        geometry,
        f"## Rendered, seed {', '.join(map(str, arguments.rendered_seeds))}",
        "320x240 pixels with motion blur and measured depth; the shipped models detect and "
        "re-identify people.",
        rendered,
    ]
    write(__file__, "Tracking from a robot that drives", *parts)


def _table(
    method: Method, scenarios: Iterable[str], seeds: Sequence[int], fidelity: Fidelity
) -> str:
    with tempfile.TemporaryDirectory() as scratch:
        cases = _cases(scenarios, seeds, fidelity, Path(scratch))
        rows = [_row(case, _matchings(case.recordings, method)) for case in cases]
    return markdown(HEADER, rows)


def _cases(
    scenarios: Iterable[str], seeds: Sequence[int], fidelity: Fidelity, scratch: Path
) -> Iterator[Case]:
    cache = default_folder()
    for name in scenarios:
        text = (FOLDER / f"{name}.toml").read_text(encoding="utf-8")
        if fidelity != "geometry":
            text = text.replace("[camera]\n", f"[camera]\n{SMALL}")
        plans = {name: text, f"{name}_still": re.sub(r"(?ms)^drive = \[.*?^\]$", "", text)}
        for stem, plan in plans.items():
            (scratch / f"{stem}.toml").write_text(plan, encoding="utf-8")
        driving, standing = (
            plan_recordings([f"lab:{scratch / stem}.toml"], seeds, fidelity, cache)
            for stem in plans
        )
        _render([*driving, *standing])
        yield Case(name, "stands", standing)
        yield Case(name, "drives", driving)
        if fidelity == "geometry":
            blind = [_without_odometry(take, scratch) for take in driving]
            yield Case(name, "drives, no odometry", blind)


def _render(recordings: Sequence[EvaluationRecording]) -> None:
    plan = EvaluationPlan((), tuple(recordings), default_folder())
    with progress() as report:
        render_all(plan, report)


def _without_odometry(take: EvaluationRecording, scratch: Path) -> EvaluationRecording:
    """Return the recording with odometry that reports a standing robot."""
    path = scratch / f"{take.name}_none.mcap"
    with RecordingWriter(path) as writer:
        for stamp_ns, message in open_recording(take.path).messages():
            writer.write(_standing(message), stamp_ns)
    return EvaluationRecording(f"{take.name}_none", take.scenario, path, take.seed, take.simulation)


def _standing(message: Message) -> Message:
    if isinstance(message, Odometry):
        return msgspec.structs.replace(message, x_m=0.0, y_m=0.0, theta_rad=0.0, twist=None)
    return message


def _matchings(recordings: Sequence[EvaluationRecording], method: Method) -> list[Matching]:
    plan = EvaluationPlan((method,), tuple(recordings), default_folder())
    with progress() as report, Pool(1, report) as pool:
        runs = runs_of(plan, pool)
    return [execute(one).matching for one in runs]


def _row(case: Case, matchings: Sequence[Matching]) -> list[str]:
    scores = [score_matching(matching) for matching in matchings]
    figures = [one.row() for one in scores]
    measured = [one.pose_parts["measured"].row() for one in scores]
    pairs = [velocities(matching) for matching in matchings]
    speeds = [
        s
        for true, estimated in pairs
        if len(s := _lengths(estimated[_lengths(true) < STANDING_MPS]))
    ]

    errors = [(estimated - true)[_lengths(true) >= WALKING_MPS] for true, estimated in pairs]
    walking = [_rmse_mps(error) for error in errors if len(error)]

    def of(name: str, form: str = "{:.3f}", factor: float = 1.0) -> str:
        return spread([factor * (figure[name] or 0.0) for figure in figures], form)

    return [
        case.scenario,
        case.name,
        spread([float(np.median(s)) for s in speeds], "{:.3f}") if speeds else "-",
        spread([float(np.percentile(s, 95)) for s in speeds], "{:.3f}") if speeds else "-",
        spread(walking, "{:.3f}") if walking else "-",
        spread([_position_m(figure) for figure in figures], "{:.3f}"),
        spread([_position_m(figure) for figure in measured], "{:.3f}"),
        of("id_switches_per_min", "{:.1f}"),
        of("coverage", "{:.1f}", 100),
    ]


def _position_m(figure: Mapping[str, float | None]) -> float:
    """Return the error of positions on the ground, x and y combined."""
    return math.hypot(*(figure[f"position_rmse_{axis}_m"] or 0.0 for axis in ("across", "along")))


def _rmse_mps(errors: F64) -> float:
    return math.sqrt(float(np.mean(np.sum(errors**2, axis=1))))


def _lengths(vectors: F64) -> F64:
    return np.asarray(np.linalg.norm(vectors, axis=1))


def velocities(matching: Matching) -> tuple[F64, F64]:
    """Return the true and the estimated velocities [m/s] of people in view, Nx2 each."""
    pairs = list[tuple[F64, F64]]()
    for frame, step in zip(matching.sequence.frames, matching.frame_matches, strict=True):
        true, estimated = frame.truth.velocities_mps, frame.hypotheses.velocities_mps
        if true is None or estimated is None:
            continue
        for row, column in zip(step.rows, step.columns, strict=True):
            if frame.truth.required[row]:
                pairs.append((true[row, :2], estimated[column, :2]))
    both = np.array(pairs, np.float64).reshape(-1, 2, 2)
    return both[:, 0], both[:, 1]
