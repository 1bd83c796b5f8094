"""Noise constants of the trackers: [PIC4SeR]'s beside others, on a simulation and on real people.

Detections and embeddings are made once; only the tracker runs again for each row. The recordings of
people are not part of the repository; `--shared` names the folder that holds them.
"""

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from benchmarks.lib.published import published_tracker
from benchmarks.lib.table import markdown, write
from benchmarks.real_inputs import ROOT, Played, gather, lockstep, models
from common.geometry.transform_buffer import TransformBuffer
from common.geometry.transform_history import TransformBufferConfig
from common.geometry.transforms import wrap
from common.metrics.from_messages import ground_truth_of, hypotheses_of
from common.metrics.live import LiveScorer
from common.metrics.matching import Matcher
from common.metrics.record import EvaluationFrame
from common.metrics.similarity import GroundDistance
from evaluation.pipeline import pipeline, play, track_again
from evaluation.recordings.hand_annotations import compare, crossing_camera
from people4d.messages import Track, Tracks, Truth, TruthPerson
from services.detector.config import DetectorConfig
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.registry import open_truth
from services.tracker.config import Sort3dConfig, TrackerConfig

DEMO = ROOT / "deploy" / "demo" / "crossing.mcap"
NOISES = ((0.5, 0.5), (2.0, 0.5), (2.0, 0.3), (2.0, 0.2), (3.0, 0.3), (3.0, 0.2), (3.0, 0.1))


@dataclass(frozen=True)
class Setting:
    """One row of the table.

    Args:
        words: The tracker and what is set.
        config: The configuration.
    """

    words: str
    config: TrackerConfig


def settings() -> Iterator[Setting]:
    """Yield what is compared, [PIC4SeR]'s constants first."""
    for sigma_a, sigma_m in NOISES:
        words = f"strongsort3d, {sigma_a:g} m/s², {sigma_m:g} m"
        config = published_tracker(
            "strongsort3d", sigma_acceleration_mps2=sigma_a, sigma_measurement_m=sigma_m
        )
        yield Setting(words, config)
    sort3d = published_tracker("sort3d")
    yield Setting("sort3d", sort3d)
    ungated = Sort3dConfig(iou_gate=False)
    yield Setting("sort3d, no IoU gate", replace(sort3d, sort3d=ungated))


def demo_cells(tracks: Sequence[Tracks], truth: Sequence[Truth]) -> list[str]:
    """Return errors against the truth: position, velocity, yaw, ID switches."""
    scorer = LiveScorer(TransformBuffer(TransformBufferConfig()), Counter())
    for true in truth:
        scorer.add_truth(true)
    scores = []
    for tracked in tracks:
        scorer.add_tracks(tracked)
        scores += scorer.due()
    total = scores[-1].total if scores else None
    if total is None or total.position_rmse_m is None or total.velocity_rmse_mps is None:
        return ["none"] * 4
    return [
        f"{total.position_rmse_m:.3f}",
        f"{total.velocity_rmse_mps:.2f}",
        f"{np.degrees(np.median(yaw_errors_rad(tracks, truth))):.0f}",
        str(total.id_switches),
    ]


def match_people(people: Sequence[TruthPerson], tracks: Sequence[Track]) -> list[tuple[int, int]]:
    """Return the pairs (person, track) within 1 m with the least sum of distances."""
    frame = EvaluationFrame(
        stamp_ns=0, truth=ground_truth_of(people), hypotheses=hypotheses_of(tracks)
    )
    matches = Matcher(GroundDistance()).match(frame)
    return list(zip(matches.rows.tolist(), matches.columns.tolist(), strict=True))


def yaw_errors_rad(tracks: Sequence[Tracks], truth: Sequence[Truth]) -> list[float]:
    """Return how far headings are from the chest's, where a person has both."""
    at = {message.stamp_ns: message for message in truth}
    errors = []
    for message in tracks:
        people = at[message.stamp_ns].people if message.stamp_ns in at else ()
        for i, j in match_people(people, message.tracks):
            true_rad, yaw_rad = people[i].yaw_rad, message.tracks[j].yaw_rad
            if true_rad is not None and yaw_rad is not None:
                errors.append(abs(wrap(yaw_rad - true_rad)))
    return errors


def crossing_cells(played: Played, tracks: Sequence[Tracks]) -> list[str]:
    """Return the number of tracks, and how many of the people marked by hand are identified."""
    identities = {t.id for m in tracks for t in m.tracks if t.state == "confirmed"}
    return [str(len(identities)), str(compare(played.detections, tracks).identified)]


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description="Compare constants of the trackers.")
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    shared = parser.parse_args().shared
    truth = list(open_truth(GtBridgeConfig(truth=str(DEMO))))
    demo = gather(play(lockstep(DEMO), pipeline(DetectorConfig())))
    crossing = [
        gather(play(crossing_camera(shared), pipeline(DetectorConfig(model=model))))
        for model in models(shared).values()
    ]
    rows = []
    for setting in settings():
        cells = demo_cells(track_again(demo.messages, setting.config), truth)
        for played in crossing:
            cells += crossing_cells(played, track_again(played.messages, setting.config))
        rows.append([setting.words, *cells])
    header = ["tracker", "position RMSE m", "velocity RMSE m/s", "yaw error median °", "switches"]
    for name in models(shared):
        header += [f"{name}: tracks", "identified of 22"]
    note = (
        "First columns: the shipped recording (three people, movenet-multipose) against its truth; "
        "positions lie on the surface that faces the camera, about 0.13 m before the truth. Then "
        "six people who walk a loop and hide each other, see [real_inputs.md](real_inputs.md). "
        "Embedder: histogram. The first row has [PIC4SeR]'s constants (acceleration, measurement)."
    )
    write(__file__, "Trackers: constants of the noise", note, markdown(header, rows))


if __name__ == "__main__":
    main()
