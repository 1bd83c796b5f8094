"""The colour layer alone: success and frames a second, as in Tables 3.1 to 3.5 of the source.

A box is started at the true one in the first frame, without any detection after that. Success is
the ratio of frames in which it overlaps the true box of the entire body by half or more.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from benchmarks.lib.gait.numpy_scores import scores
from benchmarks.lib.gait.recordings import GaitRecording, overlap
from benchmarks.lib.table import markdown, spread
from people4d.messages import F64, U8
from services.gait.colour.colour_layer import ColourLayer
from services.gait.colour.colour_ratio import ColourRatio
from services.gait.colour.histogram import SAMPLES, HueSaturationHistogram, hsv_patch, sample_grid
from services.gait.config import PUBLISHED_TAU, ColourLayerConfig

SUCCESS = 0.5  # overlap from which on a frame counts
PARTICLES = tuple(range(20, 180, 20))
TIMED_PARTICLES = tuple(range(20, 140, 20))
SIZES = ((100, 150), (150, 150), (150, 200), (150, 250))
ROUND_FRAMES = 30  # whose mean time is one round of a timing
# As published but for sigma: with 1 all particles weigh nearly the same.
PUBLISHED: dict[str, Any] = {"weights": "distance", "tau": PUBLISHED_TAU}
PUBLISHED_SIGMA: dict[str, Any] = {**PUBLISHED, "sigma": 1.0}
OURS: dict[str, Any] = {}

KINDS = {"as published, sigma 1": PUBLISHED_SIGMA, "as published": PUBLISHED, "default": OURS}
TWO = {"as published": PUBLISHED, "default": OURS}
WALKS = ("gait_walk", "gait_medium")
SAME_PERCENT = 0.5  # percent of success within which two are equal

PUBLISHED_PARTICLES = (37.5, 49, 68, 79, 85.5, 87, 90.5, 91)
PUBLISHED_FPS = {
    (100, 150): (27.56, 17.26, 12.71, 10.11, 8.44, 7.48),
    (150, 150): (22.19, 13.32, 9.43, 7.20, 5.73, 5.05),
    (150, 200): (18.36, 10.36, 7.21, 5.85, 4.85, 3.81),
    (150, 250): (14.89, 8.31, 5.91, 4.72, 4.43, 4.10),
}
SPEEDS = {"gait_slow": (0.4, 84.0), "gait_medium": (0.8, 82.5), "gait_fast": (1.2, 74.5)}
MODELS: Mapping[str, tuple[dict[str, Any], float]] = {
    "8-tuple, first order": ({"state": 8, "order": 1}, 83.0),
    "4-tuple, first order": ({"state": 4, "order": 1}, 81.0),
    "4-tuple, second order": ({"state": 4, "order": 2}, 77.5),
    "8-tuple, second order": ({"state": 8, "order": 2}, 59.0),
}
SAMPLING = {"plain": 60.0, "hierarchical": 79.5}


@dataclass(frozen=True)
class ColourSequence:
    """Images of a recording with one person's true boxes: N frames, Nx4 pixels."""

    frames: list[U8]
    boxes_px: F64


def colour_sequence(recording: GaitRecording) -> ColourSequence:
    """Return a recording as images in memory."""
    return ColourSequence(
        [frame.rgb for frame in recording.frames()], recording.truth.boxes_px[:, 0]
    )


def success(recording: ColourSequence, seed: int, fields: Mapping[str, Any]) -> float:
    """Return the ratio of frames, in percent, in which the box is on the person.

    Args:
        recording: Images and ground truth.
        seed: Of the filter.
        fields: Of the configuration that are not the default.
    """
    layer = ColourLayer(ColourLayerConfig(**fields), seed)
    assert layer.start_person(0, recording.frames[0], recording.boxes_px[0])
    pairs = zip(recording.frames[1:], recording.boxes_px[1:], strict=True)
    hits = [overlap(layer.update_boxes(rgb)[0].box_xyxy_px, box) >= SUCCESS for rgb, box in pairs]
    return 100 * float(np.mean(hits))


Fields = Mapping[str, Any]


def settings(counts: Sequence[int]) -> list[Fields]:
    """Return all configurations that the tables of success need.

    Args:
        counts: Of particles, for Table 3.1.
    """
    wanted = [{**kind, "particles": count} for kind in KINDS.values() for count in counts]
    wanted += [{**kind, "particles": 100} for kind in TWO.values()]
    for kind in TWO.values():
        wanted += [{**kind, "particles": 100, **model} for model, _ in MODELS.values()]
        wanted += [{**kind, "particles": 50, "sampling": name} for name in SAMPLING]
    return list({key_of(fields): fields for fields in wanted}.values())


@dataclass(frozen=True)
class ColourRuns:
    """Recordings and seeds of the runs of a scenario.

    Args:
        scenario: Of all.
        seeds: One recording each.
        filters: Seeds of the filter, for every recording.
    """

    scenario: str
    seeds: Sequence[int]
    filters: Sequence[int]


def run(recordings: ColourRuns, wanted: Sequence[Fields]) -> dict[str, list[float]]:
    """Return the success of configurations by their key, one value for each recording and seed."""
    found: dict[str, list[float]] = {key_of(fields): [] for fields in wanted}
    for recording_seed in recordings.seeds:
        recording = colour_sequence(GaitRecording(recordings.scenario, recording_seed))
        for fields in wanted:
            found[key_of(fields)] += [
                success(recording, seed, fields) for seed in recordings.filters
            ]
    return found


def key_of(fields: Fields) -> str:
    """Return the key of a configuration, with defaults."""
    return str(msgspec.json.encode(ColourLayerConfig(**fields)))


@dataclass(frozen=True)
class SuccessRates:
    """Success in percent by scenario and by the key of the configuration."""

    found: Mapping[str, Mapping[str, Sequence[float]]]

    def values(self, scenarios: Sequence[str], fields: Fields) -> list[float]:
        """Return the success of a configuration in all recordings and with all seeds."""
        return [value for name in scenarios for value in self.found[name][key_of(fields)]]

    def mean(self, scenarios: Sequence[str], fields: Fields) -> float:
        """Return the mean success."""
        return float(np.mean(self.values(scenarios, fields)))

    def formatted(self, scenarios: Sequence[str], fields: Fields) -> str:
        """Return the mean success with minimum and maximum, as text."""
        values = self.values(scenarios, fields)
        return f"{np.mean(values):.1f} ({min(values):.0f} to {max(values):.0f})"


def by_particles(found: SuccessRates, counts: Sequence[int]) -> str:
    """Return Table 3.1."""
    rows = []
    for count in counts:
        cells = [found.formatted(WALKS, {**kind, "particles": count}) for kind in KINDS.values()]
        published = PUBLISHED_PARTICLES[PARTICLES.index(count)]
        rows.append([str(count), f"{published:g}", *cells])
    return markdown(["particles", "published", *KINDS], rows)


def by_speed(found: SuccessRates) -> str:
    """Return Table 3.3."""
    rows = [
        [f"{speed} m/s", f"{published:g}", *_two(found, [scenario], {"particles": 100})]
        for scenario, (speed, published) in SPEEDS.items()
    ]
    return markdown(["walking at", "published", *TWO], rows)


def by_model(found: SuccessRates) -> str:
    """Return Table 3.4."""
    rows = [
        [name, f"{published:g}", *_two(found, WALKS, {"particles": 100, **fields})]
        for name, (fields, published) in MODELS.items()
    ]
    return markdown(["motion model", "published", *TWO], rows)


def by_sampling(found: SuccessRates) -> str:
    """Return Table 3.5."""
    rows = [
        [name, f"{published:g}", *_two(found, WALKS, {"particles": 50, "sampling": name})]
        for name, published in SAMPLING.items()
    ]
    return markdown(["sampling, 50 particles", "published", *TWO], rows)


def _two(found: SuccessRates, scenarios: Sequence[str], fields: Fields) -> list[str]:
    return [found.formatted(scenarios, {**kind, **fields}) for kind in TWO.values()]


def orderings(found: SuccessRates, counts: Sequence[int]) -> dict[str, dict[str, bool]]:
    """Return which published orderings are reproduced, by ordering and configuration."""
    formatted: dict[str, dict[str, bool]] = {}
    speeds = list(SPEEDS)
    for name, kind in TWO.items():
        few, many = ({**kind, "particles": count} for count in (counts[0], counts[-1]))
        hundred = {**kind, "particles": 100}
        rates = [found.mean([scenario], hundred) for scenario in speeds]
        models = [found.mean(WALKS, {**hundred, **fields}) for fields, _ in MODELS.values()]
        plain, hierarchical = (
            found.mean(WALKS, {**kind, "particles": 50, "sampling": sampling})
            for sampling in SAMPLING
        )
        claims = {
            "more particles track better": found.mean(WALKS, few) < found.mean(WALKS, many),
            "fast walks are harder than slow ones": rates[0] > rates[-1],
            "8-tuple of first order is the best model": models[0] >= max(models) - SAME_PERCENT,
            "8-tuple of second order is the worst model": models[3] <= min(models) + SAME_PERCENT,
            "hierarchical sampling is better at 50 particles": hierarchical > plain,
        }
        for claim, holds in claims.items():
            formatted.setdefault(claim, {})[name] = holds
    return formatted


def rates(recording: ColourSequence, fields: Mapping[str, Any], rounds: int) -> str:
    """Return Table 3.2: frames a second by size of the box and number of particles."""
    header = [
        "box",
        *(f"{count} particles" for count in TIMED_PARTICLES),
        "published at 20 and 120",
    ]
    rows = []
    for size in SIZES:
        cells = []
        for count in TIMED_PARTICLES:
            wanted = {**fields, "particles": count}
            cells.append(spread(list(_rounds(recording, size, wanted, rounds)), "{:.0f}"))
        published = PUBLISHED_FPS[size]
        rows.append([f"{size[0]}x{size[1]}", *cells, f"{published[0]:.1f}, {published[-1]:.1f}"])
    return markdown(header, rows)


def growth(recording: ColourSequence, fields: Mapping[str, Any], rounds: int) -> float:
    """Return the ratio of the times of a frame with the largest and the smallest box."""
    wanted = {**fields, "particles": 100}
    slow, fast = (
        np.median(list(_rounds(recording, size, wanted, rounds))) for size in (SIZES[-1], SIZES[0])
    )
    return float(fast / slow)


def _rounds(
    recording: ColourSequence, size: tuple[int, int], fields: Mapping[str, Any], rounds: int
) -> Iterator[float]:
    """Yield frames a second of the layer alone, once for each round of frames."""
    middle = (recording.boxes_px[0, :2] + recording.boxes_px[0, 2:]) / 2
    half = np.array(size) / 2
    for seed in range(rounds):
        layer = ColourLayer(ColourLayerConfig(**fields), seed)
        layer.start_person(0, recording.frames[0], np.concatenate([middle - half, middle + half]))
        layer.update_boxes(recording.frames[0])
        begin_ns = time.perf_counter_ns()
        for rgb in recording.frames[1 : 1 + ROUND_FRAMES]:
            layer.update_boxes(rgb)
        yield ROUND_FRAMES * 1e9 / (time.perf_counter_ns() - begin_ns)


def comparing_ms(recording: ColourSequence, rounds: int) -> dict[str, list[float]]:
    """Return the times of weighing 100 boxes of 150x250, by NumPy and compiled."""
    random = np.random.default_rng(0)
    middle = (recording.boxes_px[0, :2] + recording.boxes_px[0, 2:]) / 2
    centres = middle + random.normal(0, 10, (100, 2))
    boxes = np.concatenate([centres, np.full((100, 2), (150.0, 250.0))], axis=1)
    rgb = recording.frames[0]
    bins = HueSaturationHistogram()
    ratios = ColourRatio(bins)
    model = ratios.learn_colours(hsv_patch(rgb, boxes[:1] * ratios.reach), boxes[0])
    grid = sample_grid(SAMPLES)
    times: dict[str, list[float]] = {"numpy": [], "compiled": []}
    for _ in range(rounds + 1):
        begin_ns = time.perf_counter_ns()
        scores(rgb, boxes, model, grid, bins)
        middle_ns = time.perf_counter_ns()
        ratios.score_boxes(hsv_patch(rgb, boxes), boxes, model)
        times["numpy"].append((middle_ns - begin_ns) / 1e6)
        times["compiled"].append((time.perf_counter_ns() - middle_ns) / 1e6)
    return {name: values[1:] for name, values in times.items()}
