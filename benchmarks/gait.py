"""Published experiments on gait [Liu 2018], repeated on rendered recordings with ground truth.

Recordings and detections are cached; rendering them takes about half an hour. `--part` measures
one part and prints it.
"""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np

from benchmarks.lib import options
from benchmarks.lib.gait import colour as gait_colour
from benchmarks.lib.gait import points as gait_points
from benchmarks.lib.gait.points import (
    CASES,
    FEATURES,
    LIMBS,
    RIGHT_HAND,
    PointResults,
    PointVariant,
)
from benchmarks.lib.gait.recordings import GaitRecording
from benchmarks.lib.table import markdown, write

RECORDING_SEEDS, QUICK_RECORDING_SEEDS = (71, 72), (71,)
STEADY = {"gait_side": "walking across the view", "gait_approach": "walking to and fro"}
THREE = {"gait_three": "three people"}
INTRO = """Simulated people, one or three, 2.7 to 5 m before a camera of 640x480 at 30 Hz; depth has
the errors of a stereo sensor. Spreads are minimum and maximum over recordings and seeds of filters.
`default` is the service; `as published` lacks the additions of this project. The published figures
[Liu 2018] are from its own recordings with a Kinect v2: compare orderings, not values."""

DETECTED = (*CASES, *STEADY, *THREE)  # scenarios with detection of people
NEEDED = {
    "colour": (*gait_colour.WALKS, *gait_colour.SPEEDS),
    "points": tuple(CASES),
    "service": DETECTED,
}

Sections = dict[str, str]


@dataclass(frozen=True)
class Plan:
    """Extent of the measurements.

    Args:
        recordings: Seeds of recordings.
        filters: Seeds of filters of points.
        colour_filters: Seeds of filters of colours.
        counts: Numbers of particles.
        jobs: Number of processes.
    """

    recordings: Sequence[int]
    filters: Sequence[int]
    colour_filters: Sequence[int]
    counts: Sequence[int]
    jobs: int

    def __str__(self) -> str:
        """Describe the plan in the report."""
        recordings = " and ".join(map(str, self.recordings))
        return (
            f"Seeds of recordings: {recordings}; of filters: {len(self.filters)} for points, "
            f"{len(self.colour_filters)} for colours."
        )


FULL = Plan(RECORDING_SEEDS, (1, 2), (1, 2, 3, 4, 5), gait_colour.PARTICLES, 2)
QUICK = Plan(QUICK_RECORDING_SEEDS, (1,), (1, 2), (20, 100), 2)


def colour(plan: Plan) -> Sections:
    """Measure the success of the colour layer."""
    scenarios = dict.fromkeys((*gait_colour.WALKS, *gait_colour.SPEEDS))
    wanted = gait_colour.settings(plan.counts)
    few = [{**kind, "particles": 100} for kind in gait_colour.TWO.values()]
    with _pool(plan) as pool:
        tasks = {
            (name, seed): pool.submit(
                gait_colour.run,
                gait_colour.ColourRuns(name, (seed,), plan.colour_filters),
                wanted if name in gait_colour.WALKS else few,
            )
            for name in scenarios
            for seed in plan.recordings
        }
        _wait("colours", tasks.values())
        merged: dict[str, dict[str, list[float]]] = {name: {} for name in scenarios}
        for (name, _), task in tasks.items():
            for key, values in task.result().items():
                merged[name].setdefault(key, []).extend(values)
    found = gait_colour.SuccessRates(merged)
    walks = gait_colour.WALKS
    aim = found.mean(walks, {"particles": 100})
    text = [
        "A box is started at the true one in the first frame, without any detection after that. "
        "Success: the ratio of frames, in percent, in which it overlaps the true box of the entire "
        f"body by half or more. With 100 particles, by default: {aim:.1f} % (aim: 95).",
        "By number of particles (Table 3.1). Sigma 1 is the published constant, with which "
        "all particles weigh nearly the same:",
        gait_colour.by_particles(found, plan.counts),
        "By walking speed, 100 particles (Table 3.3):",
        gait_colour.by_speed(found),
        "By motion model, 100 particles (Table 3.4):",
        gait_colour.by_model(found),
        "By sampling (Table 3.5):",
        gait_colour.by_sampling(found),
    ]
    return {"Colour layer: success": "\n\n".join(text)}


def points(plan: Plan) -> Sections:
    """Track points by each feature, marked by hand as published."""
    variants = {feature: gait_points.by_hand(feature) for feature in FEATURES}
    runs = _follow_all(plan, CASES, list(variants.values()))
    text = [
        "Points are marked where they are first visible, by hand in the source. Boxes are the true "
        "ones; 100 particles, no keypoints. An error is the distance to the middle of the hand or "
        "foot by the joints, in frames in which it is visible; the last column is the distance to "
        "the visible surface, on which points are marked. All cases, combined: median and 90th "
        f"percentile {_limbs_cm(runs)} cm (aims: 5, 15).",
        "The right hand alone, as published:",
        gait_points.table(runs, [RIGHT_HAND]),
        "Published orderings that are reproduced, by the median error of the right hand to the "
        "surface:",
        markdown(["published ordering", "here"], _orderings(runs)),
    ]
    return {
        "Points: spin images, geodesic distances, combined (Figures 5.7 to 5.9)": "\n\n".join(text)
    }


def service(plan: Plan) -> Sections:
    """Track points by the configuration of the service."""
    cases = {**CASES, **STEADY, **THREE}
    runs = _follow_all(plan, cases, [gait_points.SERVICE, gait_points.NO_KEYPOINTS])
    alone = {
        (case, "keypoints and depth alone"): [
            gait_points.keypoints_alone(GaitRecording(scenario, seed)) for seed in plan.recordings
        ]
        for scenario, case in cases.items()
    }
    order = [
        (case, variant)
        for case in cases.values()
        for variant in (*_VARIANTS, "keypoints and depth alone")
    ]
    both = {**runs, **alone}
    with_them = {case: runs[case, gait_points.SERVICE.name] for case in cases.values()}
    everything = [run for found in with_them.values() for run in found]
    median, ninth, ratio = gait_points.figures([_joined(everything)], LIMBS)
    points_text = [
        "Boxes and keypoints are the detector's (MoveNet), and no point is marked. `keypoints and "
        "depth alone`: depth at the expected pixel of the keypoint, without a filter. Published %: "
        "share of the visible points with a position, measured or predicted.",
        f"All cases, with keypoints: median {median.split()[0]} cm (aim: 4), 90th percentile "
        f"{ninth.split()[0]} cm (aim: 9), published {ratio} %. Hands and feet:",
        gait_points.table({key: both[key] for key in order}, LIMBS),
    ]
    return {"Points: the service": "\n\n".join(points_text)}


_VARIANTS = (gait_points.SERVICE.name, gait_points.NO_KEYPOINTS.name)


PARTS: dict[str, Callable[[Plan], Sections]] = {
    "colour": colour,
    "points": points,
    "service": service,
}


def _follow_all(
    plan: Plan, cases: Mapping[str, str], variants: Sequence[PointVariant]
) -> dict[tuple[str, str], list[PointResults]]:
    """Track all variants; runs are in the order of recordings, then of filters."""
    with _pool(plan) as pool:
        tasks = {
            (case, variant.name): [
                pool.submit(_follow, scenario, recording, variant, seed)
                for recording in plan.recordings
                for seed in plan.filters
            ]
            for scenario, case in cases.items()
            for variant in variants
        }
        _wait("points", [task for found in tasks.values() for task in found])
        return {key: [task.result() for task in found] for key, found in tasks.items()}


def _wait(name: str, tasks: Iterable[Future[Any]]) -> None:
    """Wait for tasks and print the number of finished tasks."""
    waiting, begin_s = list(tasks), time.monotonic()
    for done, _ in enumerate(as_completed(waiting), 1):
        gone_s = time.monotonic() - begin_s
        print(f"\r{name}: {done} of {len(waiting)} runs, {gone_s:.0f} s", end="", flush=True)
    print(flush=True)


def _follow(scenario: str, recording: int, variant: PointVariant, seed: int) -> PointResults:
    return gait_points.track_points(GaitRecording(scenario, recording), variant, seed)


def _orderings(runs: Mapping[tuple[str, str], Sequence[PointResults]]) -> list[list[str]]:
    """Return the published orderings, with flags and margins of their reproduction."""

    def median_cm(case: str, feature: str, part: slice = slice(None)) -> float:
        errors = [run.surface_errors_m[part, :, RIGHT_HAND].ravel() for run in runs[case, feature]]
        return 100 * float(np.nanmedian(np.concatenate(errors)))

    walking, turning, before = CASES.values()
    first = slice(0, 60)
    claims = {
        "spin images are better at first, while the posture changes little (2 s)": (
            median_cm(walking, "spin", first),
            median_cm(walking, "geodesic", first),
        ),
        "geodesic distances are better in sudden turns": (
            median_cm(turning, "geodesic"),
            median_cm(turning, "spin"),
        ),
        "spin images are better with the hand before the torso": (
            median_cm(before, "spin"),
            median_cm(before, "geodesic"),
        ),
    }
    rows = [
        [claim, f"{'yes' if better < worse else 'no'}: {better:.1f} against {worse:.1f} cm"]
        for claim, (better, worse) in claims.items()
    ]
    both = {
        case: [median_cm(case, feature) for feature in ("combined", "spin", "geodesic")]
        for case in CASES.values()
    }
    ratio = "; ".join(
        f"{case} {'yes' if ours < min(rest) else 'no'}" for case, (ours, *rest) in both.items()
    )
    return [*rows, ["(ours) combined is better than either alone", ratio]]


def _limbs_cm(runs: Mapping[tuple[str, str], Sequence[PointResults]]) -> str:
    """Return median and 90th percentile of all hands and feet tracked by both features."""
    everything = [run for case in CASES.values() for run in runs[case, "combined"]]
    median, ninth, _ = gait_points.figures([_joined(everything)], LIMBS)
    return f"{median.split()[0]}, {ninth.split()[0]}"


def _joined(runs: Sequence[PointResults]) -> PointResults:
    """Return joined runs, person after person."""
    flat = [
        [getattr(run, name).reshape(-1, 1, *getattr(run, name).shape[2:]) for run in runs]
        for name in PointResults.__dataclass_fields__
    ]
    return PointResults(*(np.concatenate(parts) for parts in flat))


def _pool(plan: Plan) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(plan.jobs, get_context("spawn"))


def _prepare(plan: Plan, parts: Iterable[str]) -> None:
    """Create recordings, ground truth and detections missing in the cache."""
    names = dict.fromkeys(name for part in parts for name in NEEDED[part])
    for seed in plan.recordings:
        for name in names:
            recording = GaitRecording(name, seed)
            if not recording.path.exists():
                print(f"rendering {name} with seed {seed}", flush=True)
            recording.render(plan.jobs)
            assert len(recording.truth.boxes_px)
            if name in DETECTED:
                assert recording.detections


def main() -> None:
    """Measure, and write the report."""
    parser = options.parser(__doc__, "quick")
    parser.add_argument("--part", choices=PARTS, action="append", help="only this; may be repeated")
    arguments = parser.parse_args()
    plan, parts = QUICK if arguments.quick else FULL, arguments.part or list(PARTS)
    _prepare(plan, parts)
    sections = list[str]()
    for name in parts:
        begin_s = time.monotonic()
        for title, text in PARTS[name](plan).items():
            sections.append(f"## {title}\n\n{text}")
        print(f"part {name}: {time.monotonic() - begin_s:.0f} s", flush=True)
    is_dry = arguments.quick or bool(arguments.part)
    write(__file__, "Gait", INTRO.replace("\n", " "), str(plan), *sections, dry=is_dry)
