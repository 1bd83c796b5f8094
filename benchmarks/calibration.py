"""Calibration of several cameras by people who walk, against the ground truth of the lab.

    python -m benchmarks.calibration [--seeds 20] [--few 5]

Detections are synthetic (lab, fidelity geometry): cameras of 7.5 to 15 Hz with offsets and drifts
of their clocks, times of transport that differ by camera. Everything follows from the seed.
"""

import argparse
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.lib.calibration_scenes import (
    DEPTHS,
    KINDS,
    TWO,
    CalibrationScene,
    SceneKind,
    read_scene,
)
from benchmarks.lib.table import markdown, write
from common.calibration.solve import CalibrationResult, calibrate
from common.geometry.transforms import invert
from people4d.errors import CalibrationError

FIRST_SEED = 1000  # seeds below were used while the method was made
ABOUT = {
    "two": "two people",
    "two_depth": "the same, and depth of the floor",
    "one": "one person",
    "row_2.0": "two people, a row whose neighbours share 2.0 m, 2 min",
    "row_1.5": "two people, a row whose neighbours share 1.5 m, 2 min",
    "row_1.0": "two people, a row whose neighbours share 1.0 m, 4 min",
    "row_1.0_depth": "the same, and depth of the floor",
    "row_1.0_tags": "the same row and walk, and two tags of 0.3 m before the first and last camera",
    "row_1.0_between": "the same row, 4 min, two people who walk where the views of two meet",
    "row_1.0_between_depth": "the same, and depth of the floor",
    "row": "two people, a row whose neighbours share 0.3 m, 1 min",
    "row_long": "the same, 4 min",
    "crowd": "four people",
    "rough": "two people, twice the noise, surface in place of the torso's axis, 1 of 14 missed",
    "rough_depth": "the same, and depth of the floor",
    "cluttered": "two people, a false alarm in every second frame",
    "apart": "four people, no two cameras see the same floor",
    "focal": "two people, focal length of c2 wrong by 10 %",
    "mirrored": "two alike whose walks mirror each other",
    "still": "two people who stand",
}
HEADER = [
    *("scene", "seeds", "calibrated", "position p50 cm", "worst cm", "rotation p50 deg"),
    *("worst deg", "clock p50 ms", "worst ms", "position worst, in its own sigmas"),
    *("tilt worst deg", "floor worst cm", "time s"),
]


@dataclass(frozen=True)
class Errors:
    """Errors of one calibration, of its worst camera."""

    position_m: float
    rotation_rad: float
    clock_s: float
    in_sigmas: float  # largest position error by the standard deviation of that camera
    tilt_rad: float
    floor_m: float
    took_s: float


def main() -> None:
    """Calibrate all scenes and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="of the first scene")
    parser.add_argument("--few", type=int, default=5, help="seeds of the others")
    arguments = parser.parse_args()
    rows, refusals = list[list[str]](), list[list[str]]()
    for kind in KINDS:
        count = arguments.seeds if kind.name.startswith(TWO.name) else arguments.few
        done, problems = run(kind, range(FIRST_SEED, FIRST_SEED + count))
        rows.append(_row(kind, count, done))
        refusals += _refusals(kind, problems)
        print(rows[-1], problems, flush=True)
    write(
        __file__,
        "Calibration by walking",
        "Four cameras, 60 s where nothing else is said, seeds used for nothing else. Errors are "
        "those of the worst of the three cameras against the first, whose pose and clock are the "
        "reference; tilt and floor are of the first camera, against the floor that people's feet "
        f"show or, where it says so, {DEPTHS} depth images of each camera with the sensor's noise. "
        "Views of neighbours in a row share so much 3 m before them; people walk anywhere, 1.6 to "
        "4.4 m before the cameras.",
        markdown(HEADER, rows),
        "## Refused",
        markdown(["scene", "seeds", "what is said, of the first of them"], refusals),
    )


def run(kind: SceneKind, seeds: Sequence[int]) -> tuple[list[Errors], list[tuple[int, str]]]:
    """Calibrate scenes; return errors, and the seeds that were refused with the reason."""
    done, problems = list[Errors](), list[tuple[int, str]]()
    for seed in seeds:
        scene = read_scene(kind, seed)
        start_s = time.process_time()
        try:
            found = calibrate(scene.observed, tags=scene.tags)
        except CalibrationError as error:
            problems.append((seed, str(error)))
            continue
        done.append(errors_of(found, scene, time.process_time() - start_s))
    return done, problems


def errors_of(found: CalibrationResult, scene: CalibrationScene, took_s: float) -> Errors:
    """Return the errors of a calibration."""
    reference = found.reference
    true, clocks = scene.map_from_camera, scene.clock_s
    position, rotation, clock, in_sigmas = [], [], [], []
    for name, pose in found.poses.items():
        if name == reference:
            continue
        error = invert(invert(true[reference]) @ true[name]) @ pose.matrix
        position.append(float(np.linalg.norm(error[:3, 3])))
        in_sigmas.append(position[-1] / pose.sigma_m)
        rotation.append(_angle(error[:3, :3]))
        clock.append(abs(pose.offset_s - (clocks[name] - clocks[reference])))
    own = found.map_from_camera[reference]
    cosine = float(own[2, :3] @ true[reference][2, :3])
    return Errors(
        position_m=max(position),
        rotation_rad=max(rotation),
        clock_s=max(clock),
        in_sigmas=max(in_sigmas),
        tilt_rad=float(np.arccos(np.clip(cosine, -1, 1))),
        floor_m=abs(float(own[2, 3] - true[reference][2, 3])),
        took_s=took_s,
    )


def _angle(rotation: np.ndarray) -> float:
    return float(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1)))


def _row(kind: SceneKind, count: int, done: Sequence[Errors]) -> list[str]:
    start = [ABOUT[kind.name], str(count), str(len(done))]
    if not done:
        return [*start, *["-"] * 10]
    position = [100 * e.position_m for e in done]
    rotation = [float(np.degrees(e.rotation_rad)) for e in done]
    clock = [1000 * e.clock_s for e in done]
    return [
        *start,
        *(f"{np.median(position):.1f}", f"{max(position):.1f}"),
        *(f"{np.median(rotation):.2f}", f"{max(rotation):.2f}"),
        *(f"{np.median(clock):.1f}", f"{max(clock):.1f}"),
        f"{max(e.in_sigmas for e in done):.1f}",
        f"{max(np.degrees(e.tilt_rad) for e in done):.2f}",
        f"{max(100 * e.floor_m for e in done):.1f}",
        f"{np.median([e.took_s for e in done]):.1f}",
    ]


def _refusals(kind: SceneKind, problems: Sequence[tuple[int, str]]) -> list[list[str]]:
    """Return rows of refusals that differ in names of cameras and numbers alone."""
    rows = dict[str, list[str]]()
    for seed, problem in problems:
        row = rows.setdefault(re.sub(r"[\d., ]+|c\d|and", "", problem), [problem])
        row.append(str(seed))
    return [[ABOUT[kind.name], ", ".join(seeds), said] for said, *seeds in rows.values()]


if __name__ == "__main__":
    main()
