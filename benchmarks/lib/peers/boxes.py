"""Boxes on public sequences, tracked by our methods and by other packages."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from benchmarks.lib.odometry.rides import Ride
from benchmarks.lib.peers.run import PeerRun, PeerSequence, run_peers
from common.metrics.mot_text import read_info, read_rows, sequence
from common.metrics.record import EvaluationSequence
from common.metrics.scores import Row, Scores, combine, score
from common.metrics.similarity import box_overlap
from evaluation.datasets.boxes import image_frame
from people4d.messages import F64
from services.tracker.config import ImageSortConfig
from services.tracker.image_sort.image_sort import BoxTracks, ImageSort

# Tuning split of MOT15: a moving camera and a static one
TUNING = ("ETH-Bahnhof", "TUD-Stadtmitte")
HELD_OUT = ("ADL-Rundle-6", "KITTI-17", "TUD-Campus")
BLOCK_S, BLOCKS_MAX = 2.0, 20  # [s] minimum length of a unit; maximum number in a sequence


@dataclass(frozen=True)
class Tracked:
    """Tracks of one method on sequences."""

    sequences: tuple[EvaluationSequence, ...]
    times_us: tuple[float, ...]  # times of frames
    settings: str = ""

    _known: dict[tuple[int, ...], Scores] = field(default_factory=dict)  # scores so far

    @cached_property
    def blocks(self) -> list[tuple[int, list[int]]]:
        """Units: number of a sequence, and its frames in two seconds or more."""
        return [
            (number, block.tolist())
            for number, one in enumerate(self.sequences)
            for block in np.array_split(
                np.arange(len(one.frames)),
                min(BLOCKS_MAX, max(1, round(one.stamps_s[-1] / BLOCK_S))),
            )
        ]

    def row(self, chosen: Sequence[int]) -> Row:
        """Return the figures over some blocks."""
        frames: list[list[int]] = [[] for _ in self.sequences]
        for number, block in (self.blocks[unit] for unit in chosen):
            frames[number] += block
        scores = combine(self._score(number, here) for number, here in enumerate(frames))
        return scores.row() | {"rate_hz": 1e6 / float(np.median(self.times_us))}

    @property
    def scores(self) -> Scores:
        """Scores of all sequences together."""
        return combine(score(one, box_overlap) for one in self.sequences)

    @property
    def quality(self) -> float:
        """Criterion of settings: the mean over sequences of MOTA + IDF1 + HOTA."""
        rows = [score(one, box_overlap).row() for one in self.sequences]
        return float(np.mean([sum(r[k] or 0 for k in ("mota", "idf1", "hota")) for r in rows]))

    def _score(self, number: int, frames: Sequence[int]) -> Scores:
        key = (number, *frames)
        if key not in self._known:
            one = self.sequences[number]
            chosen = replace(one, frames=tuple(one.frames[k] for k in frames))
            self._known[key] = score(chosen, box_overlap)
        return self._known[key]


def mot15_rides(shared: Path, names: Iterable[str]) -> list[Ride]:
    """Read sequences of MOT15: public detections and truth."""
    return [_mot_ride(shared / "data" / "mot15" / name) for name in names]


def _mot_ride(folder: Path) -> Ride:
    info, found = read_info(folder / "seqinfo.ini"), read_rows(folder / "det" / "det.txt")
    frames = [image_frame(found.frame_rows(n), n, info) for n in range(1, info.frames + 1)]
    truth = sequence(info, read_rows(folder / "gt" / "gt.txt"), {}).frames
    return Ride(info.name, tuple(frames), tuple(one.truth for one in truth), (), frames[0].fov_deg)


def track(config: ImageSortConfig, rides: Sequence[Ride]) -> Tracked:
    """Run our tracker."""
    sequences, times_us = [], []
    for ride in rides:
        tracker, tracks = ImageSort(config), []
        for frame in ride.turned():
            turned = replace(frame, fov_deg=ride.fov_deg)
            start_ns = time.perf_counter_ns()
            tracks.append(tracker.update(turned))
            times_us.append((time.perf_counter_ns() - start_ns) / 1e3)
        sequences.append(ride.scored(tracks))
    return Tracked(tuple(sequences), tuple(times_us))


def track_peers(
    python: str, rides: Sequence[Ride], chosen: Mapping[str, Sequence[int]]
) -> dict[str, dict[int, Tracked]]:
    """Run other packages; for `chosen` and the result see `run_peers`."""
    inputs = {ride.name: peer_sequence(ride) for ride in rides}
    return {
        name: {number: _tracked(run, run.words(number), rides) for number, run in runs.items()}
        for name, runs in run_peers(python, inputs, chosen).items()
    }


def peer_sequence(ride: Ride) -> PeerSequence:
    """Return the detections for other packages."""
    seconds = (ride.frames[-1].stamp_ns - ride.frames[0].stamp_ns) / 1e9
    rows = [
        np.column_stack([np.full(len(one.scores), number), one.boxes_xyxy_px, one.scores])
        for number, one in enumerate(ride.frames, 1)
    ]
    return PeerSequence(np.vstack(rows), len(ride.frames), (len(ride.frames) - 1) / seconds)


def _tracked(run: PeerRun, words: str, rides: Sequence[Ride]) -> Tracked:
    scored = (ride.scored(_by_frame(run.rows[ride.name], len(ride.frames))) for ride in rides)
    times_us = tuple(t for ride in rides for t in run.times_us[ride.name])
    return Tracked(tuple(scored), times_us, words)


def _by_frame(rows: F64, frames: int) -> list[BoxTracks]:
    """Return tracks of a text table (frame, identity, corners), frame by frame."""
    tracks = []
    for number in range(1, frames + 1):
        here = rows[rows[:, 0] == number]
        ids = here[:, 1].astype(np.int64)
        tracks.append(BoxTracks(ids, here[:, 2:], np.ones(len(ids)), np.zeros(len(ids), np.int64)))
    return tracks
