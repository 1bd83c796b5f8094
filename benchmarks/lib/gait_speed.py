"""How quick the cascade is on one core, and where its time goes."""

import cProfile
import pstats
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.lib.gait_points import SERVICE, Way, follow, seen_in
from benchmarks.lib.gait_takes import Frame, Take
from benchmarks.lib.table import markdown
from people4d.messages import F64
from services.gait.cascade import Cascade
from services.gait.config import GaitConfig
from services.gait.warm_up import warm_up

# Functions whose time, with all that they call, is a row; none of them calls another. Then the ms a
# frame before this was made fast: on the film of seed 71, AMD EPYC, 2 cores, Python 3.11.7.
STAGES: Mapping[str, tuple[tuple[str, ...], float]] = {
    "colours: particles moved, weighed, drawn": (("colour_layer.py", "update"), 0.0),
    "colours: reference of a new box": (("colour_layer.py", "start"), 0.54),
    "floor found and taken out": (("floor.py", "update", "without"), 0.86),
    "body: holes filled, components": (("body.py", "find_body"), 2.07),
    "mesh and normals": (("surface.py", "surface_of"), 4.22),
    "distances along the body": (("geodesic.py", "geodesic_m"), 0.75),
    "ends of limbs": (("tips.py", "tips_of"), 0.52),
    "spin images": (("spin_image.py", "spin_images"), 2.99),
    "comparing spin images": (("spin_image.py", "similarity"), 1.61),
    "weights of particles": (("weighing.py", "alone", "together"), 2.00),
    "particles moved and drawn": (("point_filter.py", "predict", "resample", "settle"), 0.59),
}
ELSE_BEFORE_MS, WHOLE_BEFORE_MS = 6.88, 23.03
# Frames a second, p50 and p99 in ms before; the longest frames waited for the compiler.
RATES_BEFORE = {"one": "17, 41.3, 315.7", "three": "12, 66.1, 348.5"}


def rates(takes: Mapping[str, Take], way: Way = SERVICE) -> str:
    """Return frames a second of the whole cascade with five points each.

    The processor's time is told, too: unlike the other it does not depend on what else runs.
    """
    warm_up(GaitConfig(cascade=way.config))
    rows = []
    for name, take in takes.items():
        wall_ms, busy_ms = frame_times_ms(take, list(take.frames()), way)
        p50, p99 = np.quantile(wall_ms, (0.5, 0.99))
        rows.append(
            [
                name,
                f"{1000 / wall_ms.mean():.0f}",
                f"{p50:.1f}",
                f"{p99:.1f}",
                f"{busy_ms.mean():.1f}",
                f"{np.quantile(busy_ms, 0.99):.1f}",
                RATES_BEFORE.get(name, "-"),
            ]
        )
    header = ["people", "frames a second", "p50 ms", "p99 ms", "processor: mean ms", "p99 ms"]
    return markdown([*header, "before: frames a second, p50, p99"], rows)


def frame_times_ms(take: Take, frames: Sequence[Frame], way: Way) -> tuple[F64, F64]:
    """Return the time of each frame by the clock and by the processor."""
    cascade, wall_ns, busy_ns = Cascade(way.config, take.info), [], []
    for index, frame in enumerate(frames):
        seen = seen_in(take, index, way)
        wall, busy = time.perf_counter_ns(), time.process_time_ns()
        cascade.update(frame.stamp_ns, frame.rgb, frame.depth_mm, seen)
        wall_ns.append(time.perf_counter_ns() - wall)
        busy_ns.append(time.process_time_ns() - busy)
    return np.array(wall_ns) / 1e6, np.array(busy_ns) / 1e6


def profile(take: Take, way: Way = SERVICE) -> str:
    """Return the time of each stage a frame, as the profiler sees it, which slows it a little."""
    warm_up(GaitConfig(cascade=way.config))
    frames = list(take.frames())
    profiler = cProfile.Profile()
    profiler.enable()
    follow(take, way, 0, frames)
    profiler.disable()
    return markdown(["stage", "ms before", "ms now", "share %"], _rows(profiler, len(frames)))


def _rows(profiler: cProfile.Profile, frames: int) -> list[list[str]]:
    stats: dict[tuple[str, int, str], tuple[int, int, float, float, object]]
    stats = pstats.Stats(profiler).stats  # type: ignore[attr-defined]

    def spent_ms(file: str, *names: str) -> float:
        found = [
            row[3]
            for (path, _, name), row in stats.items()
            if path.endswith(f"services/gait/{file}") and name in names
        ]
        return 1000 * sum(found) / frames

    whole_ms = spent_ms("cascade.py", "update")
    rows = [(stage, before, spent_ms(*names)) for stage, (names, before) in STAGES.items()]
    rows.append(("all else", ELSE_BEFORE_MS, whole_ms - sum(row[2] for row in rows)))
    rows.append(("whole cascade", WHOLE_BEFORE_MS, whole_ms))
    return [
        [stage, f"{before:.2f}", f"{now:.2f}", f"{100 * now / whole_ms:.0f}"]
        for stage, before, now in rows
    ]


def timed_ms(work: Callable[[], object], rounds: int) -> list[float]:
    """Return the time of each round of some work, the first left out."""
    times = []
    for _ in range(rounds + 1):
        begin_ns = time.perf_counter_ns()
        work()
        times.append((time.perf_counter_ns() - begin_ns) / 1e6)
    return times[1:]
