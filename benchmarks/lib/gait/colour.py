"""Success of the colour layer alone, as in Tables 3.1 and 3.3 to 3.5 of the source.

A box is started at the true one in the first frame, without any detection after that. Success is
the ratio of frames in which it overlaps the true box of the entire body by half or more.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from benchmarks.lib.gait.recordings import GaitRecording, overlap
from benchmarks.lib.table import markdown
from people4d.messages import F64, U8
from services.gait.colour.colour_layer import ColourLayer
from services.gait.config import PUBLISHED_TAU, ColourLayerConfig

SUCCESS = 0.5  # minimum overlap of a successful frame
PARTICLES = tuple(range(20, 180, 20))
# Published settings except sigma, since 1 gives all particles nearly equal weights.
PUBLISHED: dict[str, Any] = {"weights": "distance", "tau": PUBLISHED_TAU}
PUBLISHED_SIGMA: dict[str, Any] = {**PUBLISHED, "sigma": 1.0}
OURS: dict[str, Any] = {}

KINDS = {"as published, sigma 1": PUBLISHED_SIGMA, "as published": PUBLISHED, "default": OURS}
TWO = {"as published": PUBLISHED, "default": OURS}
WALKS = ("gait_walk", "gait_medium")

PUBLISHED_PARTICLES = (37.5, 49, 68, 79, 85.5, 87, 90.5, 91)
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
        seed: Seed of the filter.
        fields: Settings other than the defaults.
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
        counts: Numbers of particles for Table 3.1.
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
        scenario: Scenario of all runs.
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
    """Return success by sampling, as in Table 3.5 of [Liu 2018]."""
    rows = [
        [name, f"{published:g}", *_two(found, WALKS, {"particles": 50, "sampling": name})]
        for name, published in SAMPLING.items()
    ]
    return markdown(["sampling, 50 particles", "published", *TWO], rows)


def _two(found: SuccessRates, scenarios: Sequence[str], fields: Fields) -> list[str]:
    return [found.formatted(scenarios, {**kind, **fields}) for kind in TWO.values()]
