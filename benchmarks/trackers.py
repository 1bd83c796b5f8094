"""Trackers: time of one update by the number of people, and SORT in the image beside others.

The second part needs the reference data (`--shared`). `--peers` names a Python interpreter that has
the packages to compare with; `lib/peers/mot.py` tells how to make one. Without it they are left
out.
"""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import msgspec
import numpy as np

from benchmarks.lib import options
from benchmarks.lib.peers.mot import PEERS
from benchmarks.lib.peers.mot15 import (
    HELD_OUT,
    TUNING,
    MotSequence,
    cells,
    load_all,
    quality,
    score_tracks,
)
from benchmarks.lib.peers.published import published_tracker
from benchmarks.lib.peers.run import PeerSequence, run_peers
from benchmarks.lib.table import markdown, spread, write
from evaluation.methods import read_method
from people4d.messages import F64
from services.tracker.build import make_tracker
from services.tracker.config import ImageSortConfig
from services.tracker.image_sort.image_sort import BoxFrame, BoxTracks, ImageSort
from services.tracker.interface import Measurement, Observation

PEOPLE = (2, 4, 10, 50, 200)
FRAMES = {2: 300, 4: 300, 10: 300, 50: 120, 200: 50}
WARM_UP = 15
DIMENSION = 512  # of an embedding, as OSNet's
FRAME_NS = 33_333_333
SIZE_PX = (640, 480)
FAITHFUL = ImageSortConfig()
T = TypeVar("T")


@dataclass(frozen=True)
class Result:
    """Results of one tracker with one setting."""

    words: str
    tracks: dict[str, list[BoxTracks]]  # by sequence
    times_us: dict[str, list[float]]  # of each frame, by sequence


def choices() -> Iterator[ImageSortConfig]:
    """Yield the settings of our own among which the tuning sequences choose."""
    lifetimes = [("fixed", 5.0, 30.0)]
    lifetimes += [("dynamic", r, age) for r in (2.0, 5.0, 10.0) for age in (5.0, 8.0, 15.0)]
    for score_high, (lifetime, r, max_age) in itertools.product((0.0, 0.8), lifetimes):
        yield ImageSortConfig(
            score_new=0.9,
            score_high=score_high,
            confirm="once",
            min_hits=0,
            lifetime="dynamic" if lifetime == "dynamic" else "fixed",
            r=r,
            max_age=max_age,
        )


def observations(people: int, frames: int, seed: int) -> list[Observation]:
    """Return frames of people who walk back and forth across the image, with noise."""
    rng = np.random.default_rng(seed)
    appearances = rng.normal(size=(people, DIMENSION))
    phase, forward_m = rng.uniform(0, 2 * np.pi, people), np.linspace(2.0, 5.0, people)
    tracks = []
    for number in range(frames):
        stamp_ns = number * FRAME_NS
        side_m = 1.5 * np.sin(phase + 0.7 * stamp_ns / 1e9)
        measurements = []
        for k in range(people):
            position = np.array([forward_m[k], side_m[k], 1.0]) + rng.normal(0, 0.03, 3)
            u, half = 320 - 600 * side_m[k] / forward_m[k], 150 / forward_m[k]
            appearance = appearances[k] + rng.normal(0, 0.1, DIMENSION)
            measurements.append(
                Measurement(
                    index=k,
                    box_xyxy_px=np.array([u - half, 240 - 3 * half, u + half, 240 + 3 * half]),
                    score=0.9,
                    position_m=position,
                    forward_m=float(position[0]),
                    covariance_m2=np.diag([0.01, 0.001, 0.001]),
                    embedding=appearance / np.linalg.norm(appearance),
                    yaw_rad=float(rng.normal(0, 0.3)),
                    yaw_sigma_rad=0.3,
                )
            )
        camera = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1], [0, 0, 0, 1]])
        tracks.append(
            Observation(
                stamp_ns,
                tuple(measurements),
                embedder="osnet",
                map_from_camera=camera,
                size_px=SIZE_PX,
            )
        )
    return tracks


def boxes_of(observation: Observation) -> BoxFrame:
    """Return what a tracker in the image takes of a frame."""
    people = observation.measurements
    boxes = np.array([m.box_xyxy_px for m in people])
    return BoxFrame(observation.stamp_ns, boxes, np.array([m.score for m in people]), SIZE_PX)


def times_us(update: Callable[[T], object], frames: Sequence[T]) -> list[float]:
    """Return the time of each update in microseconds."""
    times = []
    for frame in frames:
        start_ns = time.perf_counter_ns()
        update(frame)
        times.append((time.perf_counter_ns() - start_ns) / 1e3)
    return times


def cost_rows(chosen: ImageSortConfig, rounds: int, quick: bool) -> list[list[str]]:
    """Return the time of an update of each tracker by the number of people."""
    solid = {
        "sort3d": published_tracker("sort3d"),
        "strongsort3d": published_tracker("strongsort3d"),
        "strongsort3d of the preset best": read_method("best").tracker,
    }
    flat = {"SORT in the image": FAITHFUL, "SORT in the image, chosen": chosen}
    rows = {name: [name] for name in (*solid, *flat)}
    for people in PEOPLE:
        medians: dict[str, list[float]] = {name: [] for name in rows}
        for seed in range(rounds):
            frames = observations(people, 20 + WARM_UP if quick else FRAMES[people], seed)
            boxes = [boxes_of(frame) for frame in frames]
            for name, config in solid.items():
                times = times_us(make_tracker(config).update, frames)[WARM_UP:]
                medians[name].append(float(np.median(times)))
            for name, image_config in flat.items():
                times = times_us(ImageSort(image_config).update, boxes)[WARM_UP:]
                medians[name].append(float(np.median(times)))
        for name, values in medians.items():
            rows[name].append(spread(values, "{:.0f}"))
    return list(rows.values())


def follow(config: ImageSortConfig, sequences: dict[str, MotSequence]) -> Result:
    """Run our own."""
    tracks: dict[str, list[BoxTracks]] = {}
    times: dict[str, list[float]] = {}
    for name, one in sequences.items():
        tracker = ImageSort(config)
        times[name] = times_us(tracker.update, one.frames)
        tracker = ImageSort(config)
        tracks[name] = [tracker.update(frame) for frame in one.frames]
    return Result(format_settings(config), tracks, times)


def format_settings(config: ImageSortConfig) -> str:
    """Return what differs from the source works' values, as text."""
    names = config.__struct_fields__
    changed = [name for name in names if getattr(config, name) != getattr(FAITHFUL, name)]
    return ", ".join(f"{name} {getattr(config, name)}" for name in changed) or "SORT's"


def ask_peers(
    python: str, sequences: dict[str, MotSequence], chosen: dict[str, list[int]]
) -> dict[str, dict[int, Result]]:
    """Run the packages of others in their own environment.

    Returns:
        Results by tracker and number of the setting; the first is the package's own.
    """
    inputs = {
        name: PeerSequence(one.rows, one.info.frames, one.info.rate_hz)
        for name, one in sequences.items()
    }
    return {
        tracker: {
            number: Result(
                run.settings,
                {n: by_frame(run.rows[n], s.info.frames) for n, s in sequences.items()},
                run.times_us,
            )
            for number, run in runs.items()
        }
        for tracker, runs in run_peers(python, inputs, chosen).items()
    }


def by_frame(rows: F64, frames: int) -> list[BoxTracks]:
    """Return tracks of a text table (frame, identity, corners), frame by frame."""
    tracks = []
    for number in range(1, frames + 1):
        here = rows[rows[:, 0] == number]
        ids = here[:, 1].astype(np.int64)
        tracks.append(BoxTracks(ids, here[:, 2:], np.ones(len(ids)), np.zeros(len(ids), np.int64)))
    return tracks


def worth(result: Result, sequences: dict[str, MotSequence]) -> float:
    """Return how good a result is on the tuning sequences."""
    return quality(score_tracks(sequences[name], result.tracks[name]) for name in TUNING)


def rate_hz(results: Sequence[Result]) -> str:
    """Return frames per second over all sequences, with the spread over runs."""
    rates = []
    for result in results:
        times = [t for name in result.times_us for t in result.times_us[name]]
        rates.append(1e6 * len(times) / sum(times))
    return spread(rates, "{:.0f}")


def mot_row(name: str, results: Sequence[Result], sequences: dict[str, MotSequence]) -> list[str]:
    """Return one row of the comparison; the runs differ in time only."""
    row = [name]
    for names in (HELD_OUT, TUNING):
        row += cells(score_tracks(sequences[n], results[0].tracks[n]) for n in names)
    row += [rate_hz(results), results[0].words]
    print(*row, sep=" | ", flush=True)
    return row


def compare(
    python: str | None, sequences: dict[str, MotSequence], rounds: int, quick: bool
) -> tuple[ImageSortConfig, list[list[str]]]:
    """Choose settings on the tuning sequences, for all trackers alike, and judge on the others."""
    tuning = {name: sequences[name] for name in TUNING}
    own = [FAITHFUL] if quick else list(choices())
    chosen = max(own, key=lambda config: worth(follow(config, tuning), sequences))
    runs = range(rounds)
    rows = []
    one_round = msgspec.structs.replace(chosen, score_high=0.0)
    ours = {"ours, SORT": FAITHFUL, "ours, chosen": chosen, "ours, chosen, one round": one_round}
    for name, config in ours.items():
        rows.append(mot_row(name, [follow(config, sequences) for _ in runs], sequences))
    if python is None:
        return chosen, rows
    tried = ask_peers(python, tuning, {name: [0] for name in PEERS} if quick else {})
    best = {
        name: max(results, key=lambda number: worth(results[number], sequences))
        for name, results in tried.items()
    }
    again = [
        ask_peers(python, sequences, {name: sorted({0, k}) for name, k in best.items()})
        for _ in runs
    ]
    for name, number in best.items():
        kinds = {"own settings": 0, "chosen": number}
        for words, k in kinds.items():
            rows.append(mot_row(f"{name}, {words}", [one[name][k] for one in again], sequences))
    return chosen, rows


def main() -> None:
    """Measure and write the tables."""
    parser = options.parser(__doc__, "shared", "quick")
    parser.add_argument("--peers", help="Python interpreter with the packages to compare with")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    sequences = load_all(arguments.shared)
    chosen, rows = compare(arguments.peers, sequences, arguments.rounds, arguments.quick)
    cost = cost_rows(chosen, arguments.rounds, arguments.quick)
    if not arguments.peers:
        missing = "Packages of others are missing: see `--peers`."
    else:
        missing = "Packages of others run in an environment of their own (peers/mot.py)."
    write(
        __file__,
        "Trackers: cost and quality",
        f"## Time of one update [us]\n\n{arguments.rounds} rounds, one thread: median of the "
        "updates; of the rounds the middle (least to most). Joining and messages are not included.",
        markdown(["tracker", *(f"{n} people" for n in PEOPLE)], cost),
        "## SORT in the image beside others\n\nPublic detections of MOT15, the same for all. Every "
        f"tracker's settings were chosen on {' and '.join(TUNING)} by the sum of MOTA, IDF1 and "
        f"HOTA from 4 to 20 (choices here, PEERS in peers/mot.py). First figures: "
        f"{', '.join(HELD_OUT)}, on which nothing was chosen; but which choices ours has was "
        "narrowed down in trials that had seen all five. Differences below a point are chance. "
        "Frames per second over all five sequences, from arrays of boxes and scores to identities "
        "and boxes, detection not "
        f"included. {missing}",
        markdown(
            [
                "tracker",
                *("MOTA %", "IDF1 %", "HOTA %", "ID switches"),
                *(f"{word}, tuning" for word in ("MOTA", "IDF1", "HOTA", "switches")),
                *("frames/s", "settings"),
            ],
            rows,
        ),
    )
