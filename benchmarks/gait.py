"""The thesis' experiments on gait, on films of the virtual lab with their truth.

Films and what the detector sees in them are made once and kept, which takes about half an hour;
with them all parts take about twelve minutes on two cores. `--part` measures one part anew and
leaves the other parts of the report as they are; times want a quiet machine, the rest does not.
"""

import argparse
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.lib import gait_colour, gait_points, gait_speed, gait_steps
from benchmarks.lib.gait_picture import draw
from benchmarks.lib.gait_points import CASES, FEATURES, LIMBS, RIGHT_HAND, Followed, Way
from benchmarks.lib.gait_takes import Take
from benchmarks.lib.table import machine, markdown, spread

REPORT = Path(__file__).with_suffix(".md")
PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "gait-errors.png"
FILMS, QUICK_FILMS = (71, 72), (71,)
STEADY = {"gait_side": "walking across the view", "gait_approach": "walking to and fro"}
THREE = {"gait_three": "three people"}
INTRO = """Films of the virtual lab: one or three people 2.7 to 5 m before a camera of 640x480 at
30 Hz, depth with the errors of a stereo sensor. Spreads are the least and the most over films
(other light, textures, noise and motion) and seeds of the filters. `default` is what the service
does; `as in the paper` leaves out what this project added. The paper's own figures are of its own
recordings with a Kinect v2: compare orderings, not values."""

DETECTED = (*CASES, *STEADY, *THREE)  # scenarios in which a detector is needed, too
NEEDED = {
    "colour": (*gait_colour.WALKS, *gait_colour.SPEEDS),
    "points": tuple(CASES),
    "service": DETECTED,
    "speed": ("gait_medium", "gait_walk", "gait_three"),
}

Sections = dict[str, str]


@dataclass(frozen=True)
class Plan:
    """How much is measured.

    Args:
        films: Seeds of films.
        filters: Seeds of filters of points.
        colour_filters: Seeds of filters of colours.
        counts: Of particles.
        rounds: Of timings.
        jobs: Processes at once, where no times are taken.
    """

    films: Sequence[int]
    filters: Sequence[int]
    colour_filters: Sequence[int]
    counts: Sequence[int]
    rounds: int
    jobs: int

    def __str__(self) -> str:
        """Tell so in the report."""
        films = " and ".join(map(str, self.films))
        return (
            f"Seeds of films: {films}; of filters: {len(self.filters)} for points, "
            f"{len(self.colour_filters)} for colours; rounds of timings: {self.rounds}."
        )


FULL = Plan(FILMS, (1, 2), (1, 2, 3, 4, 5), gait_colour.PARTICLES, 7, 2)
QUICK = Plan(QUICK_FILMS, (1,), (1, 2), (20, 100), 2, 2)


def colour(plan: Plan) -> Sections:
    """Measure the success of the colour layer."""
    scenarios = dict.fromkeys((*gait_colour.WALKS, *gait_colour.SPEEDS))
    wanted = gait_colour.settings(plan.counts)
    few = [{**kind, "particles": 100} for kind in gait_colour.TWO.values()]
    with _pool(plan) as pool:
        tasks = {
            (name, seed): pool.submit(
                gait_colour.run,
                gait_colour.Films(name, (seed,), plan.colour_filters),
                wanted if name in gait_colour.WALKS else few,
            )
            for name in scenarios
            for seed in plan.films
        }
        _watch("colours", tasks.values())
        merged: dict[str, dict[str, list[float]]] = {name: {} for name in scenarios}
        for (name, _), task in tasks.items():
            for key, values in task.result().items():
                merged[name].setdefault(key, []).extend(values)
    found = gait_colour.Successes(merged)
    walks = gait_colour.WALKS
    aim = found.mean(walks, {"particles": 100})
    rows = [
        [claim, *("yes" if holds else "no" for holds in kinds.values())]
        for claim, kinds in gait_colour.orderings(found, plan.counts).items()
    ]
    text = [
        "A box is started at the true one in the first frame and nothing helps it after that. "
        "Success: the share of frames, in percent, in which it overlaps the true box of the whole "
        f"body by half or more. With 100 particles, by default: {aim:.1f} % (aim: 95).",
        "By number of particles (Table 3.1). Sigma 1 is the paper's own constant, with which all "
        "particles weigh nearly the same:",
        gait_colour.by_particles(found, plan.counts),
        "By walking speed, 100 particles (Table 3.3):",
        gait_colour.by_speed(found),
        "By motion model, 100 particles (Table 3.4):",
        gait_colour.by_model(found),
        "By sampling (Table 3.5):",
        gait_colour.by_sampling(found),
        "Which of the paper's orderings come out (differences below half a percent count as none):",
        markdown(["the paper finds", *gait_colour.TWO], rows),
    ]
    return {"Colour layer: success": "\n\n".join(text)}


def points(plan: Plan) -> Sections:
    """Follow points by each feature, marked by hand as in the paper."""
    ways = {feature: gait_points.by_hand(feature) for feature in FEATURES}
    runs = _follow_all(plan, CASES, list(ways.values()))
    draw(runs, CASES, FEATURES, RIGHT_HAND, PICTURE)
    text = [
        "Points are marked where they are first seen, as the paper's authors did by hand; boxes "
        "are the true ones; no keypoints; 100 particles. An error is the distance in space to what "
        "the camera sees of the middle of the hand or foot, in frames in which it sees that. "
        "Combined, a point that is lost starts anew by itself.",
        "The right hand alone, as in the paper:",
        gait_points.table(runs, [RIGHT_HAND]),
        f"![errors over time](../docs/pictures/{PICTURE.name})",
        "Hands and feet:",
        gait_points.table(runs, LIMBS),
        "Which of the paper's orderings come out, by the median error of the right hand:",
        markdown(["the paper finds", "here"], _orderings(runs)),
    ]
    return {"Points: spin images, distances, both (Figures 5.7 to 5.9)": "\n\n".join(text)}


def service(plan: Plan) -> Sections:
    """Follow points as the service does, and tell steps by them."""
    cases = {**CASES, **STEADY, **THREE}
    runs = _follow_all(plan, cases, [gait_points.SERVICE, gait_points.NO_KEYPOINTS])
    alone = {
        (case, "keypoints and depth alone"): [
            gait_points.keypoints_alone(Take(scenario, seed)) for seed in plan.films
        ]
        for scenario, case in cases.items()
    }
    order = [
        (case, way) for case in cases.values() for way in (*_WAYS, "keypoints and depth alone")
    ]
    both = {**runs, **alone}
    with_them = {case: runs[case, gait_points.SERVICE.name] for case in cases.values()}
    everything = [run for found in with_them.values() for run in found]
    median, ninth, told = gait_points.figures([_joined(everything)], LIMBS)
    points_text = [
        "Boxes and keypoints are the detector's (MoveNet); nobody marks anything. `keypoints and "
        "depth alone` is the plain way without a filter: the depth at the pixel to which the "
        "keypoint points. Told: of the frames in which the truth is seen, the share in which a "
        "place is told, measured or predicted.",
        f"All cases together, with keypoints: median {median.split()[0]} cm (aim: 5), 90th "
        f"percentile {ninth.split()[0]} cm (aim: 12), told {told} %. By the seed of the film:",
        _by_film(plan, with_them),
        "Hands and feet:",
        gait_points.table({key: both[key] for key in order}, LIMBS),
        "Each point, with keypoints:",
        gait_points.by_point(with_them),
    ]
    return {
        "Points: the service": "\n\n".join(points_text),
        "Steps": _steps(plan, runs),
    }


def _by_film(plan: Plan, runs: Mapping[str, Sequence[Followed]]) -> str:
    """Return the errors of each film's hands and feet, all cases together."""
    each = len(plan.filters)
    rows = []
    for k, film in enumerate(plan.films):
        some = [run for found in runs.values() for run in found[k * each : (k + 1) * each]]
        cells = gait_points.figures([_joined(some)], LIMBS)
        rows.append([str(film), *(cell.split()[0] for cell in cells)])
    return markdown(["film", *gait_points.HEADER], rows)


_WAYS = (gait_points.SERVICE.name, gait_points.NO_KEYPOINTS.name)


def _steps(plan: Plan, runs: Mapping[tuple[str, str], Sequence[Followed]]) -> str:
    keys = [(seed, number) for seed in plan.films for number in plan.filters]
    found: dict[str, list[gait_steps.Errors]] = {}
    by_film: dict[str, list[gait_steps.Errors]] = {}
    for scenario, case in STEADY.items():
        for way in _WAYS:
            for (seed, _), run in zip(keys, runs[case, way], strict=True):
                errors = gait_steps.judge(Take(scenario, seed), run, 0)
                found.setdefault(f"{case}, {way}", []).append(errors)
                if way == gait_points.SERVICE.name:
                    by_film.setdefault(f"film {seed}, {way}", []).append(errors)
    return "\n\n".join(
        [
            "Steps found in the paths of the feet, against all that the lab's person made, turns "
            "too. Measures are what the service tells, the means of even strides in the last "
            "seconds, compared with those of the true strides at these times, twice a second "
            "(aims: step length within 4 cm, cadence within 3 %); where there are too few strides "
            "it tells none. The lab's people do not limp: their true asymmetry is about 0.",
            gait_steps.table({**found, **by_film}),
        ]
    )


def speed(plan: Plan) -> Sections:
    """Take all times; nothing else should run meanwhile."""
    film = gait_colour.reel(Take("gait_medium", plan.films[0]))
    grown = {
        name: gait_colour.growth(film, kind, plan.rounds) for name, kind in gait_colour.TWO.items()
    }
    comparing = gait_colour.comparing_ms(film, 20)
    walk, three = Take("gait_walk", plan.films[0]), Take("gait_three", plan.films[0])
    return {
        "Colour layer: frames a second": "\n\n".join(
            [
                "One core, the layer alone (Table 3.2); median with least and most of "
                f"{plan.rounds} rounds. With 100 particles, 150x250 takes "
                + " and ".join(f"{g:.2f} times ({name})" for name, g in grown.items())
                + " as long as 100x150; in the paper 1.9 times. Aims: less than 1.5 times, and 300 "
                "frames a second with 150x250 and 100 particles.",
                "Default, which looks at each box and at what surrounds it:",
                gait_colour.rates(film, gait_colour.OURS, plan.rounds),
                "As in the paper:",
                gait_colour.rates(film, gait_colour.PAPER, plan.rounds),
            ]
        ),
        "Whole cascade": "\n\n".join(
            [
                "Boxes given by the detector, five points each, one core (aims: 30 frames a second "
                "for one person, 15 for three); the paper's Chapters 4 and 5 have 4 to 12.",
                gait_speed.rates({"one": walk, "three": three}),
            ]
        ),
        "Where the time goes": "\n\n".join(
            [
                "One person, each stage with all that it calls, under a profiler, which slows "
                "small functions:",
                gait_speed.profile(walk),
                "What compiled code and shared work are worth: 100 boxes of 150x250 "
                "weighed by their pixels took ms in NumPy: "
                f"{spread(comparing['numpy'])}; now: {spread(comparing['compiled'])}.",
            ]
        ),
    }


PARTS: dict[str, Callable[[Plan], Sections]] = {
    "colour": colour,
    "points": points,
    "service": service,
    "speed": speed,
}
ORDER = (
    "Colour layer: success",
    "Colour layer: frames a second",
    "Points: spin images, distances, both (Figures 5.7 to 5.9)",
    "Points: the service",
    "Steps",
    "Whole cascade",
    "Where the time goes",
)


def _follow_all(
    plan: Plan, cases: Mapping[str, str], ways: Sequence[Way]
) -> dict[tuple[str, str], list[Followed]]:
    """Follow films in all ways; runs come in the order of films and then of filters."""
    with _pool(plan) as pool:
        tasks = {
            (case, way.name): [
                pool.submit(_follow, scenario, film, way, seed)
                for film in plan.films
                for seed in plan.filters
            ]
            for scenario, case in cases.items()
            for way in ways
        }
        _watch("points", [task for found in tasks.values() for task in found])
        return {key: [task.result() for task in found] for key, found in tasks.items()}


def _watch(what: str, tasks: Iterable[Future[Any]]) -> None:
    """Wait for tasks and tell how many are done."""
    waiting, begin_s = list(tasks), time.monotonic()
    for done, _ in enumerate(as_completed(waiting), 1):
        gone_s = time.monotonic() - begin_s
        print(f"\r{what}: {done} of {len(waiting)} runs, {gone_s:.0f} s", end="", flush=True)
    print(flush=True)


def _follow(scenario: str, film: int, way: Way, seed: int) -> Followed:
    return gait_points.follow(Take(scenario, film), way, seed)


def _orderings(runs: Mapping[tuple[str, str], Sequence[Followed]]) -> list[list[str]]:
    """Return which orderings of the paper come out, and by how much."""

    def median_cm(case: str, feature: str, part: slice = slice(None)) -> float:
        errors = [run.errors_m[part, :, RIGHT_HAND].ravel() for run in runs[case, feature]]
        return 100 * float(np.nanmedian(np.concatenate(errors)))

    walking, turning, before = CASES.values()
    first = slice(0, 60)
    claims = {
        "spin images are better at first, while the posture changes little (2 s)": (
            median_cm(walking, "spin", first),
            median_cm(walking, "geodesic", first),
        ),
        "distances are better in sudden turns": (
            median_cm(turning, "geodesic"),
            median_cm(turning, "spin"),
        ),
        "spin images are better with the hand before the trunk": (
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
    told = "; ".join(
        f"{case} {'yes' if ours < min(rest) else 'no'}" for case, (ours, *rest) in both.items()
    )
    return [*rows, ["(ours) combined is better than either alone", told]]


def _joined(runs: Sequence[Followed]) -> Followed:
    """Return runs as one, person after person."""
    flat = [
        [getattr(run, name).reshape(-1, 1, *getattr(run, name).shape[2:]) for run in runs]
        for name in ("points_m", "measured", "errors_m", "visible")
    ]
    return Followed(*(np.concatenate(parts) for parts in flat))


def _pool(plan: Plan) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(plan.jobs, get_context("spawn"))


def _prepare(plan: Plan, parts: Iterable[str]) -> None:
    """Make films, truth and detections that are not there yet."""
    names = dict.fromkeys(name for part in parts for name in NEEDED[part])
    for seed in plan.films:
        for name in names:
            take = Take(name, seed)
            if not take.path.exists():
                print(f"drawing {name} with seed {seed}", flush=True)
            take.film(plan.jobs)
            assert len(take.truth.boxes_px)
            if name in DETECTED:
                assert take.sightings


def _kept(report: Path) -> Sections:
    """Return the sections of the report that there is."""
    if not report.exists():
        return {}
    found = re.split(r"^## ", report.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return {title: body.strip() for title, _, body in (text.partition("\n") for text in found)}


def _write(sections: Sections, report: Path) -> None:
    text = [
        "# Gait",
        f"Made by `python -m benchmarks.gait` on {machine()}.",
        INTRO.replace("\n", " "),
        *(f"## {title}\n\n{sections[title]}" for title in ORDER if title in sections),
    ]
    report.write_text("\n\n".join(text) + "\n", encoding="utf-8")


def main() -> None:
    """Measure, and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="less of everything")
    parser.add_argument("--part", choices=PARTS, action="append", help="only this; may be repeated")
    parser.add_argument("--report", type=Path, default=REPORT, help="file to write")
    arguments = parser.parse_args()
    plan, parts = QUICK if arguments.quick else FULL, arguments.part or list(PARTS)
    _prepare(plan, parts)
    sections = _kept(arguments.report)
    for name in parts:
        begin_s = time.monotonic()
        for title, text in PARTS[name](plan).items():
            sections[title] = f"{text}\n\n{plan}"
            print(f"## {title}\n\n{text}\n", flush=True)
        print(f"part {name}: {time.monotonic() - begin_s:.0f} s", flush=True)
        _write(sections, arguments.report)


if __name__ == "__main__":
    main()
