"""Time of one update of each tracker, by the number of people."""

import time

import numpy as np

from benchmarks.table import markdown, spread, write
from services.tracker.config import TrackerConfig
from services.tracker.interface import Measurement, Observation
from services.tracker.registry import TRACKERS, make_tracker

PEOPLE = (1, 5, 20)
FRAMES = 300
WARM_UP = 30
ROUNDS = 5
DIMENSION = 512  # of an embedding, as OSNet's
FRAME_NS = 33_333_333


def observations(people: int, seed: int) -> list[Observation]:
    """Return frames of people who walk back and forth across the image, with noise."""
    rng = np.random.default_rng(seed)
    looks = rng.normal(size=(people, DIMENSION))
    phase, forward_m = rng.uniform(0, 2 * np.pi, people), np.linspace(2.0, 5.0, people)
    frames = []
    for number in range(FRAMES):
        stamp_ns = number * FRAME_NS
        side_m = 1.5 * np.sin(phase + 0.7 * stamp_ns / 1e9)
        measurements = []
        for k in range(people):
            position = np.array([forward_m[k], side_m[k], 1.0]) + rng.normal(0, 0.03, 3)
            u, half = 320 - 600 * side_m[k] / forward_m[k], 150 / forward_m[k]
            look = looks[k] + rng.normal(0, 0.1, DIMENSION)
            measurements.append(
                Measurement(
                    index=k,
                    box_xyxy_px=np.array([u - half, 240 - 3 * half, u + half, 240 + 3 * half]),
                    score=0.9,
                    position_m=position,
                    forward_m=float(position[0]),
                    embedding=look / np.linalg.norm(look),
                )
            )
        frames.append(Observation(stamp_ns, tuple(measurements), embedder="osnet"))
    return frames


def times_us(name: str, frames: list[Observation]) -> list[float]:
    """Return the time of each update in microseconds, the first ones left out."""
    tracker = make_tracker(TrackerConfig(tracker=name))
    times = []
    for observation in frames:
        start_ns = time.perf_counter_ns()
        tracker.update(observation)
        times.append((time.perf_counter_ns() - start_ns) / 1e3)
    return times[WARM_UP:]


def main() -> None:
    """Measure and write the table."""
    rows = []
    for name in TRACKERS:
        for people in PEOPLE:
            rounds = [times_us(name, observations(people, seed)) for seed in range(ROUNDS)]
            medians = [float(np.median(times)) for times in rounds]
            slow = [float(np.percentile(times, 99)) for times in rounds]
            rows.append([name, str(people), spread(medians, "{:.0f}"), spread(slow, "{:.0f}")])
    header = ["tracker", "people", "p50 of an update [us]", "p99 of an update [us]"]
    note = (
        f"{ROUNDS} rounds of {FRAMES} frames, one thread; median (least to most) over the rounds. "
        f"Embeddings of {DIMENSION} numbers for StrongSORT-3D; joining and messages not included."
    )
    write(__file__, "Trackers: time of one update", note, markdown(header, rows))


if __name__ == "__main__":
    main()
