"""Frames a second of the cascade on one core, and the time of its stages."""

import cProfile
import pstats
import time
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.lib.gait.points import SERVICE, PointVariant, observations_in, track_points
from benchmarks.lib.gait.recordings import GaitRecording, RecordedFrame
from benchmarks.lib.table import markdown
from people4d.messages import F64
from services.gait.build import warm_up
from services.gait.cascade import Cascade
from services.gait.config import GaitConfig

# Functions whose time, with their callees, is a row; none of them calls another. Then ms a frame
# before optimisation: recording of seed 71, AMD EPYC, 2 cores, Python 3.11.7.
STAGES: Mapping[str, tuple[tuple[str, ...], float]] = {
    "colour layer: particles moved, weighed, resampled": (
        ("colour/colour_layer.py", "update_boxes"),
        0.0,
    ),
    "colour layer: reference of a new box": (("colour/colour_layer.py", "start_person"), 0.54),
    "floor detected and removed": (("surface/floor.py", "update_floor", "remove_floor"), 0.86),
    "segmentation: holes filled, components": (("surface/segmentation.py", "segment_body"), 2.07),
    "mesh and normals": (("surface/mesh.py", "build_mesh"), 4.22),
    "geodesic distances": (("surface/geodesic.py", "geodesic_m"), 0.75),
    "geodesic extrema": (("surface/geodesic.py", "geodesic_extrema"), 0.52),
    "spin images": (("surface/spin_image.py", "spin_images"), 2.99),
    "similarity of spin images": (("surface/spin_image.py", "similarity"), 1.61),
    "weights of particles": (
        ("points/likelihood.py", "single_feature_weights", "combined_weights"),
        2.00,
    ),
    "particles moved and resampled": (
        ("points/point_filter.py", "move_particles", "resample_particles", "project_particles"),
        0.59,
    ),
}
ELSE_BEFORE_MS, CASCADE_BEFORE_MS = 6.88, 23.03
# Frames a second, p50 and p99 in ms before; the longest frames waited for the compiler.
RATES_BEFORE = {"one": "17, 41.3, 315.7", "three": "12, 66.1, 348.5"}


def rates(recordings: Mapping[str, GaitRecording], variant: PointVariant = SERVICE) -> str:
    """Return frames a second of the entire cascade with five points each.

    The processor's time is reported, too: it does not depend on other load.
    """
    warm_up(GaitConfig(cascade=variant.config))
    rows = []
    for name, recording in recordings.items():
        wall_ms, busy_ms = frame_times_ms(recording, list(recording.frames()), variant)
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


def frame_times_ms(
    recording: GaitRecording, frames: Sequence[RecordedFrame], variant: PointVariant
) -> tuple[F64, F64]:
    """Return the time of each frame by the clock and by the processor."""
    cascade, wall_ns, busy_ns = Cascade(variant.config, recording.info), [], []
    for index, frame in enumerate(frames):
        observations = observations_in(recording, index, variant)
        wall, busy = time.perf_counter_ns(), time.process_time_ns()
        cascade.update_people(frame.stamp_ns, frame.rgb, frame.depth_mm, observations)
        wall_ns.append(time.perf_counter_ns() - wall)
        busy_ns.append(time.process_time_ns() - busy)
    return np.array(wall_ns) / 1e6, np.array(busy_ns) / 1e6


def profile(recording: GaitRecording, variant: PointVariant = SERVICE) -> str:
    """Return the time of each stage a frame, under the profiler, which slows it a little."""
    warm_up(GaitConfig(cascade=variant.config))
    frames = list(recording.frames())
    profiler = cProfile.Profile()
    profiler.enable()
    track_points(recording, variant, 0, frames)
    profiler.disable()
    return markdown(["stage", "ms before", "ms now", "ratio %"], _rows(profiler, len(frames)))


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

    cascade_ms = spent_ms("cascade.py", "update")
    rows = [(stage, before, spent_ms(*names)) for stage, (names, before) in STAGES.items()]
    rows.append(("all else", ELSE_BEFORE_MS, cascade_ms - sum(row[2] for row in rows)))
    rows.append(("entire cascade", CASCADE_BEFORE_MS, cascade_ms))
    return [
        [stage, f"{before:.2f}", f"{now:.2f}", f"{100 * now / cascade_ms:.0f}"]
        for stage, before, now in rows
    ]
