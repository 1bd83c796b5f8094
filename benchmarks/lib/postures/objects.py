"""Objects that are detected as people, and still people, by their `object_like`."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.lib.postures.run import frames
from benchmarks.lib.postures.scenes import seated, standing
from lab.world import World
from people4d.messages import F64

LIKE_MIN = 0.9  # minimum probability of a figure that is called an object
HEADER = (
    "figures",
    "number",
    "minutes",
    "object-like frames %",
    "object-like, of all",
    "after [s]",
)
SHORT_S, LONG_S = 150.0, 600.0  # durations of scenes of figures and of people [s]


@dataclass(frozen=True)
class Figure:
    """A figure and the frames in which it was called an object."""

    duration_s: float
    frames: int
    called: int  # frames in which it was called an object
    after_s: float | None  # time until the first of them


def rows(seeds: Sequence[int]) -> Iterator[list[str]]:
    """Yield a row for the simulated figures of each kind."""
    kinds: dict[str, tuple[Callable[[World, float], list[F64]], Callable[[int], World]]] = {
        "people, seated": (World.keypoints_m, partial(seated, duration_s=LONG_S)),
        "people, standing": (World.keypoints_m, partial(standing, duration_s=SHORT_S)),
        "mannequins": (mannequins, partial(standing, duration_s=SHORT_S)),
    }
    for name, (joints_m, make) in kinds.items():
        yield row(f"simulated {name}", [f for s in seeds for f in simulated(make(s), joints_m)])


def row(name: str, figures: Sequence[Figure]) -> list[str]:
    """Return the row of figures of one kind."""
    after_s = [one.after_s for one in figures if one.after_s is not None]
    shares = 100 * sum(one.called for one in figures) / max(1, sum(one.frames for one in figures))
    return [
        name,
        f"{len(figures)}",
        f"{sum(one.duration_s for one in figures) / 60:.1f}",
        f"{shares:.1f}",
        f"{len(after_s)} of {len(figures)}",
        f"{np.median(after_s):.0f}" if after_s else "-",
    ]


def figure(times_s: Sequence[float], likes: Sequence[float]) -> Figure:
    """Return a figure from its times and probabilities."""
    called = [t for t, like in zip(times_s, likes, strict=True) if like >= LIKE_MIN]
    begin_s = times_s[0]
    after_s = called[0] - begin_s if called else None
    return Figure(times_s[-1] - begin_s, len(times_s), len(called), after_s)


def simulated(world: World, joints_m: Callable[[World, float], list[F64]]) -> Iterator[Figure]:
    """Yield the figures of a scene."""
    found = defaultdict[int, list[tuple[float, float]]](list)
    for frame in frames(world, joints_m):
        for number, skeleton in enumerate(frame.skeletons):
            if skeleton is not None:
                found[number].append((frame.time_s, skeleton.object_like))
    for pairs in found.values():
        times_s, likes = zip(*pairs, strict=True)
        yield figure(times_s, likes)


def mannequins(world: World, time_s: float) -> list[F64]:  # noqa: ARG001
    """Return people who never move."""
    return world.keypoints_m(0.0)
