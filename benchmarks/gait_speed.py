"""How quick the cascade is on one core, and where its time goes."""

import cProfile
import pstats
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.gait_points import SERVICE, Way, follow, seen_in
from benchmarks.gait_takes import Frame, Take
from benchmarks.table import markdown
from services.gait.cascade import Cascade

# Functions whose time, with all that they call, is a row; none of them calls another.
STAGES = {
    "colours: particles moved, weighed, drawn": ("colour_layer.py", "update"),
    "colours: reference of a new box": ("colour_layer.py", "start"),
    "floor found and taken out": ("floor.py", "update", "without"),
    "body: holes filled, components": ("body.py", "find_body"),
    "mesh and normals": ("surface.py", "surface_of"),
    "distances along the body": ("geodesic.py", "geodesic_m"),
    "ends of limbs": ("tips.py", "tips_of"),
    "spin images": ("spin_image.py", "spin_images"),
    "comparing spin images": ("spin_image.py", "similarity"),
    "weights of particles": ("weighing.py", "alone", "together"),
    "particles moved and drawn": ("point_filter.py", "predict", "resample", "settle"),
}


def rates(takes: Mapping[str, Take], way: Way = SERVICE) -> str:
    """Return frames a second of the whole cascade with five points each."""
    rows = []
    for name, take in takes.items():
        times_ms = frame_times_ms(take, list(take.frames()), way)
        p50, p99 = np.quantile(times_ms, (0.5, 0.99))
        rows.append(
            [name, f"{1000 / times_ms.mean():.0f}", f"{p50:.1f}", f"{p99:.1f}", str(len(times_ms))]
        )
    return markdown(["people", "frames a second", "p50 ms", "p99 ms", "frames"], rows)


def frame_times_ms(take: Take, frames: Sequence[Frame], way: Way) -> np.ndarray:
    """Return the time of each frame but the first ones, in which code is loaded."""
    cascade, times = Cascade(way.config, take.info), []
    for index, frame in enumerate(frames):
        seen = seen_in(take, index, way)
        begin_ns = time.perf_counter_ns()
        cascade.update(frame.stamp_ns, frame.rgb, frame.depth_mm, seen)
        times.append((time.perf_counter_ns() - begin_ns) / 1e6)
    return np.array(times[10:])


def profile(take: Take, way: Way = SERVICE) -> str:
    """Return the time of each stage a frame, as the profiler sees it, which slows it a little."""
    frames = list(take.frames())
    profiler = cProfile.Profile()
    profiler.enable()
    follow(take, way, 0, frames)
    profiler.disable()
    return markdown(["stage", "ms a frame", "share %"], _rows(profiler, len(frames)))


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
    rows = [(stage, spent_ms(*names)) for stage, names in STAGES.items()]
    rows.append(("all else", whole_ms - sum(ms for _, ms in rows)))
    rows.append(("whole cascade", whole_ms))
    return [[stage, f"{ms:.2f}", f"{100 * ms / whole_ms:.0f}"] for stage, ms in rows]


def timed_ms(work: Callable[[], object], rounds: int) -> list[float]:
    """Return the time of each round of some work, the first left out."""
    times = []
    for _ in range(rounds + 1):
        begin_ns = time.perf_counter_ns()
        work()
        times.append((time.perf_counter_ns() - begin_ns) / 1e6)
    return times[1:]
