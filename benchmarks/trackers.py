"""SORT in the image, compared with other packages on MOT15.

`--shared` names the folder of the reference data. `--peers` names a Python interpreter with the
other packages, see `lib/peers/mot.py`; without it they are left out.
"""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from benchmarks.lib import options
from benchmarks.lib.peers.mot import PEERS
from benchmarks.lib.peers.mot15 import HELD_OUT, TUNING, cells, load_all, quality
from benchmarks.lib.peers.run import PeerSequence, run_peers
from benchmarks.lib.table import markdown, spread, write
from evaluation.datasets.boxes import BoxSequence, detection_rows
from people4d.messages import F64
from services.tracker.config import ImageSortConfig
from services.tracker.image_sort.image_sort import BoxFrame, BoxTracks, ImageSort

FAITHFUL = ImageSortConfig()


@dataclass(frozen=True)
class Result:
    """Results of one tracker with one setting."""

    words: str
    tracks: dict[str, list[BoxTracks]]  # tracks by sequence
    times_us: dict[str, list[float]]  # times of frames by sequence


def choices() -> Iterator[ImageSortConfig]:
    """Yield the settings of our tracker from which the tuning sequences choose."""
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


def times_us(update: Callable[[BoxFrame], object], frames: Sequence[BoxFrame]) -> list[float]:
    """Return the time of each update in microseconds."""
    times = []
    for frame in frames:
        start_ns = time.perf_counter_ns()
        update(frame)
        times.append((time.perf_counter_ns() - start_ns) / 1e3)
    return times


def follow(config: ImageSortConfig, sequences: dict[str, BoxSequence]) -> Result:
    """Run our tracker."""
    tracks: dict[str, list[BoxTracks]] = {}
    times: dict[str, list[float]] = {}
    for name, one in sequences.items():
        tracker = ImageSort(config)
        times[name] = times_us(tracker.update, one.frames)
        tracker = ImageSort(config)
        tracks[name] = [tracker.update(frame) for frame in one.frames]
    return Result(format_settings(config), tracks, times)


def format_settings(config: ImageSortConfig) -> str:
    """Return the settings that differ from the published values, as text."""
    names = config.__struct_fields__
    changed = [name for name in names if getattr(config, name) != getattr(FAITHFUL, name)]
    return ", ".join(f"{name} {getattr(config, name)}" for name in changed) or "SORT's"


def ask_peers(
    python: str, sequences: dict[str, BoxSequence], chosen: dict[str, list[int]]
) -> dict[str, dict[int, Result]]:
    """Run other packages in their own environment.

    Returns:
        Results by tracker and number of the setting; the first is the package's own.
    """
    inputs = {
        name: PeerSequence(detection_rows(one.frames), len(one.frames), one.rate_hz)
        for name, one in sequences.items()
    }
    return {
        tracker: {
            number: Result(
                run.settings,
                {n: by_frame(run.rows[n], len(s.frames)) for n, s in sequences.items()},
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


def worth(result: Result, sequences: dict[str, BoxSequence]) -> float:
    """Return the criterion of a result on the tuning sequences."""
    return quality(sequences[name].score(result.tracks[name]) for name in TUNING)


def rate_hz(results: Sequence[Result]) -> str:
    """Return frames per second over all sequences, with the spread over runs."""
    rates = []
    for result in results:
        times = [t for name in result.times_us for t in result.times_us[name]]
        rates.append(1e6 * len(times) / sum(times))
    return spread(rates, "{:.0f}")


def mot_row(name: str, results: Sequence[Result], sequences: dict[str, BoxSequence]) -> list[str]:
    """Return one row of the comparison; the runs differ in time only."""
    row = [name]
    for names in (HELD_OUT, TUNING):
        row += cells(sequences[n].score(results[0].tracks[n]) for n in names)
    row += [rate_hz(results), results[0].words]
    print(*row, sep=" | ", flush=True)
    return row


def compare(
    python: str | None, sequences: dict[str, BoxSequence], rounds: int, quick: bool
) -> list[list[str]]:
    """Choose settings of all trackers on the tuning sequences, and score them on the others."""
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
        return rows
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
    return rows


def main() -> None:
    """Measure and write the table."""
    parser = options.parser(__doc__, "shared", "rounds", "quick")
    parser.add_argument("--peers", help="Python interpreter with the packages to compare with")
    arguments = parser.parse_args()
    sequences = load_all(arguments.shared)
    rows = compare(arguments.peers, sequences, arguments.rounds, arguments.quick)
    write(
        __file__,
        "SORT in the image beside other packages",
        "Public detections of MOT15, the same for all. Settings of all trackers were chosen on "
        f"{' and '.join(TUNING)} by the sum of MOTA, IDF1 and HOTA, from 4 to 20 settings each. "
        f"First figures: {', '.join(HELD_OUT)}, on which no setting was chosen, but the range of "
        "our settings was narrowed down with all five sequences. Differences below a point are "
        "chance. Frames per second are over all five sequences, from arrays of boxes and scores "
        "to identities and boxes, without detection.",
        markdown(
            [
                "tracker",
                *("MOTA %", "IDF1 %", "HOTA %", "ID switches"),
                *(f"{word}, tuning" for word in ("MOTA", "IDF1", "HOTA", "switches")),
                *("frames/s", "settings"),
            ],
            rows,
        ),
        dry=arguments.quick,
    )
