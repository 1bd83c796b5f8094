"""Predictions compared with constant velocity: real pedestrians, tracks of simulated people.

Constants were chosen on seq_hotel and zara01; seq_eth is the test split.
"""

import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import matplotlib as mpl
import msgspec
import numpy as np
from matplotlib.figure import Figure

from benchmarks.lib import options
from benchmarks.lib.prediction.score import (
    GroupScores,
    PredictionPairs,
    predict_tracks,
    predict_walks,
    score_groups,
)
from benchmarks.lib.table import markdown, write
from common.io.recording import open_recording
from evaluation.cache import default_folder
from evaluation.datasets.walks import read_walks
from evaluation.methods import read_method
from evaluation.pipeline import track_again
from evaluation.recordings.recordings import plan_recordings, render_recording
from people4d.codec import decode, encode
from people4d.messages import F64, Track, Tracks, Truth
from services.predictor.build import build
from services.predictor.config import PredictorConfig

IMAGE = Path(__file__).parents[1] / "docs" / "pictures" / "prediction-calibration.png"
SCENES = ("seq_hotel", "zara01", "seq_eth")
SHOWN_S = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0)
LAB = ("lab:four_dense@301", "lab:three_crossing@301")
WARM_UP, ROUNDS = 30, 200
COUNTS = (1, 2, 5, 10, 50, 200)  # numbers of people


def main() -> None:
    """Predict, compare and write the tables and the image."""
    parser = options.parser(__doc__, "shared")
    parser.add_argument("--lab", nargs="*", default=list(LAB), help="scenarios with seeds")
    arguments = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        folders = [arguments.shared / "data" / "trajectories" / name for name in SCENES]
        scenes = dict(zip(SCENES, pool.map(score_scene, folders), strict=True))
        lab = dict(zip(arguments.lab, pool.map(score_lab, arguments.lab), strict=True))
    errors, groups = [], []
    for name, (pairs, found) in scenes.items():
        errors += error_rows(name, pairs)
        shares = (found.frame_precision, found.frame_recall, found.pair_precision)
        groups.append([name, *(f"{100 * x:.0f}" for x in (*shares, found.pair_recall))])
    draw({name: pairs for name, (pairs, _) in scenes.items()} | lab)
    shown = [f"{horizon:g} s" for horizon in SHOWN_S]
    write(
        __file__,
        "Predicted positions",
        "Mean error in metres and share of truth inside the 90 % ellipses, at each horizon. "
        "Constant velocity is the displacement since the previous annotation, in the lab the "
        "velocity of the track. ADE and FDE are in scoreboard.md.",
        "## Real pedestrians\n\nConstants were chosen on seq_hotel and zara01; seq_eth is the test "
        "split.",
        markdown(["scene", "", *shown], errors),
        "## Simulated people, tracks of the shipped tracker\n\nDetections from geometry in place "
        "of images, with errors as measured on images. Constants were chosen on other seeds of "
        "these scenes.",
        markdown(
            ["scene", "", *shown],
            [row for name, one in lab.items() for row in error_rows(name, one)],
        ),
        "## Groups\n\nPairs of people in one group, beside the annotation.",
        markdown(
            ["scene", "precision, frames %", "recall %", "precision, pairs %", "recall %"], groups
        ),
        "## Calibration\n\n![Shares of truth inside ellipses, and frequencies of outcomes, beside "
        "the predicted probabilities](../docs/pictures/prediction-calibration.png)",
        "## Cost\n\nProcessor time of one message, 10 a second: of the node, and of decoding "
        "tracks and encoding predictions.",
        *cost_table(),
    )


def score_scene(folder: Path) -> tuple[PredictionPairs, GroupScores]:
    """Predict the pedestrians of a scene."""
    walks = read_walks(folder)
    pairs, messages = predict_walks(walks, PredictorConfig())
    return pairs, score_groups(walks, messages)


def score_lab(source: str) -> PredictionPairs:
    """Track the people of a scenario, and predict them."""
    (recording,) = plan_recordings([source], [], "geometry", default_folder())
    render_recording(recording, 1, lambda _stage, _share: None)
    messages = [message for _, message in open_recording(recording.path).messages()]
    truth = {
        message.stamp_ns: {person.id: person.position_m[:2] for person in message.people}
        for message in messages
        if isinstance(message, Truth)
    }
    config = msgspec.structs.replace(
        read_method("best").tracker, embedding_wait_s=0.0, reorder_wait_s=0.0
    )
    return predict_tracks(track_again(messages, config), truth, PredictorConfig())


def error_rows(name: str, pairs: PredictionPairs) -> list[list[str]]:
    """Return table rows: errors at constant velocity, errors predicted, share in the ellipses."""
    at = [int(np.argmin(np.abs(pairs.horizons_s - horizon))) for horizon in SHOWN_S]
    before, after = pairs.constant_errors_m()[at], pairs.errors_m()[at]
    gains = 100 * (1 - after / before)
    return [
        [f"{name}, {len(pairs.means_m)}", "constant velocity", *(f"{e:.3f}" for e in before)],
        [name, "predicted", *(f"{e:.3f} ({-g:+.1f} %)" for e, g in zip(after, gains, strict=True))],
        [name, "in the ellipses %", *(f"{100 * c:.0f}" for c in pairs.covered(0.9)[at])],
    ]


def draw(pairs: dict[str, PredictionPairs]) -> None:
    """Draw coverage and reliability."""
    figure = Figure(figsize=(9, 4), dpi=80, layout="constrained")
    ellipses, motion = figure.subplots(1, 2)
    nominal = np.arange(0.1, 1.0, 0.1)
    for name, one in pairs.items():
        at = int(np.argmin(np.abs(one.horizons_s - 3.0)))
        ellipses.plot(nominal, [one.covered(p)[at] for p in nominal], marker=".", label=name)
        expected, happened = reliability(one)
        motion.plot(expected, happened, marker=".", label=name)
    for axes, what in ((ellipses, "ellipses, 3 s"), (motion, "standing, going on, turning")):
        axes.plot([0, 1], [0, 1], color="grey", linewidth=0.8)
        axes.set(title=what, xlabel="predicted probability", ylabel="share that happened")
    ellipses.legend(fontsize=7)
    with mpl.rc_context({"svg.hashsalt": "people4d"}):
        figure.savefig(IMAGE, metadata={"Software": ""})


def reliability(pairs: PredictionPairs) -> tuple[F64, F64]:
    """Return mean probability and frequency of outcomes in ten bins."""
    outcome = pairs.outcomes()
    known = outcome >= 0
    predicted = pairs.motion[known].ravel()
    happened = (outcome[known, None] == np.arange(3)).ravel()
    bins = np.minimum((predicted * 10).astype(int), 9)
    used = [number for number in range(10) if np.count_nonzero(bins == number) >= 20]
    return (
        np.array([predicted[bins == number].mean() for number in used]),
        np.array([happened[bins == number].mean() for number in used]),
    )


def cost_table() -> tuple[str, str]:
    """Return the processor times by the number of people, and a sentence on them."""
    rows, medians = [], []
    for count in COUNTS:
        node_ms, codec_ms = costs(count)
        p50, p95 = np.percentile(node_ms, (50, 95))
        medians.append(p50)
        codec = f"{np.median(codec_ms):.2f}"
        rows.append([str(count), f"{p50:.2f}", f"{p95:.2f}", f"{p50 / count:.3f}", codec])
    header = ["people", "p50 ms", "p95 ms", "p50 ms a person", "codec p50 ms"]
    more, fixed = np.polyfit(COUNTS[:4], medians[:4], 1)
    costs_text = f"a message costs {fixed:.2f} ms and {more:.3f} ms for each person"
    return markdown(header, rows), f"Up to {COUNTS[3]} people {costs_text}."


def costs(count: int) -> tuple[list[float], list[float]]:
    """Return the processor times of messages of a number of people [ms]: node, codec."""
    node = build(PredictorConfig())
    node_ms, codec_ms = [], []
    for number in range(WARM_UP + ROUNDS):
        tracks = encode(crowd(count, number * 0.1))
        start_s = time.process_time()
        message = decode(tracks)
        decoded_s = time.process_time()
        (predictions,) = node.handle(message, 0)
        handled_s = time.process_time()
        encode(predictions)
        encoded_s = time.process_time()
        node_ms.append((handled_s - decoded_s) * 1e3)
        codec_ms.append((decoded_s - start_s + encoded_s - handled_s) * 1e3)
    return node_ms[WARM_UP:], codec_ms[WARM_UP:]


def crowd(count: int, time_s: float) -> Tracks:
    """Return people walking at 1 m/s in all directions."""
    people = []
    for number in range(count):
        angle = 2.4 * number
        velocity = np.array([np.cos(angle), np.sin(angle), 0.0])
        start = np.array([1.7 * number % 20, 2.3 * number % 15, 1.0])
        people.append(
            Track(
                id=number + 1,
                state="confirmed",
                position_m=start + time_s * velocity,
                velocity_mps=velocity,
                covariance=0.01 * np.eye(6),
                yaw_rad=float(np.angle(np.exp(1j * angle))),
                hits=9,
                age=9,
                time_since_update_s=0.0,
                detection=None,
                score=0.9,
            )
        )
    stamp_ns = 10**9 + round(time_s * 1e9)
    return Tracks(
        stamp_ns=stamp_ns, sequence=0, frame_id="map", camera="c", tracker="t", tracks=tuple(people)
    )
