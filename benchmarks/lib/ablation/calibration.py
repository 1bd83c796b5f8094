"""Calibration of detections: errors of position and yaw, and probabilities of a person.

A detection belongs to the nearest person on the ground.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.lib.table import markdown
from common.metrics.record import EvaluationFrame
from evaluation.methods import read_method
from evaluation.pool import Pool
from evaluation.recordings.recordings import EvaluationRecording
from evaluation.run.preparation import EvaluationPlan, runs_of
from evaluation.run.run import EvaluationRun, execute
from people4d.messages import F64, Detection

NEAR_M = 0.5  # maximum distance of a detection to its person on the ground [m]
# Share of errors [%], and squared distance of the ellipse or interval that holds it
CHI2_2DOF, CHI2_1DOF = {90: 4.605, 99: 9.210}, {90: 2.706, 99: 6.635}
BINS = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 1.0)  # limits of probabilities of a person
NOTE = f"""A detection is of a person if one is within {NEAR_M} m on the ground. Positions on the
ground by their covariance, yaws by their standard deviation."""
HEADER = (
    "detections of people",
    *(f"position in the {share} % ellipse, %" for share in CHI2_2DOF),
    *("mean square / 2", "RMS across, along the ray m"),
    *(f"yaw in the {share} % interval, %" for share in CHI2_1DOF),
    "RMS yaw deg",
)


class DetectionErrors(NamedTuple):
    """Errors of one detection; all but `person` are NaN if no person is near."""

    person: float  # probability of a person; NaN: unknown
    square: float  # squared Mahalanobis distance of the position
    across_m: float
    along_m: float
    yaw_square: float  # squared error over the variance
    yaw_deg: float


def calibration_tables(
    scenes: Mapping[tuple[str, str], Sequence[EvaluationRecording]], cache: Path, jobs: int
) -> str:
    """Return tables by split and simulator; detections of all scenes are in the cache."""
    rows, probabilities = [], []
    for (split, simulator), recordings in scenes.items():
        plan = EvaluationPlan((read_method("best"),), tuple(recordings), cache, jobs)
        with Pool(jobs, lambda _stage, _share: None) as pool:
            errors = np.array([row for run in runs_of(plan, pool) for row in _errors(run)])
        if len(errors):
            name = f"{simulator}, {split}"
            rows.append([f"{name}, {np.isfinite(errors[:, 1]).sum()}", *_figures(errors)])
            probabilities.append([name, *_reliability(errors)])
    bins = [f"{low:g} to {high:g}" for low, high in pairwise(BINS)]
    reliability = markdown(("people of N detections, % by `person`", *bins), probabilities)
    return f"{NOTE}\n\n{markdown(HEADER, rows)}\n\n{reliability}"


def _figures(errors: F64) -> Iterator[str]:
    squares = errors[:, 1][np.isfinite(errors[:, 1])]
    yield from (f"{100 * np.mean(squares < limit):.1f}" for limit in CHI2_2DOF.values())
    yield f"{squares.mean() / 2:.2f}"
    yield ", ".join(f"{m:.3f}" for m in np.sqrt(np.nanmean(errors[:, 2:4] ** 2, axis=0)))
    yaws = errors[:, 4][np.isfinite(errors[:, 4])]
    yield from (f"{100 * np.mean(yaws < limit):.1f}" for limit in CHI2_1DOF.values())
    yield f"{math.sqrt(np.nanmean(errors[:, 5] ** 2)):.1f}"


def _reliability(errors: F64) -> Iterator[str]:
    """Yield the share of people among the detections of each bin of probability."""
    person, is_person = errors[:, 0], np.isfinite(errors[:, 2])
    for low, high in pairwise(BINS):
        inside = (person >= low) & ((person < high) | (high == 1.0))
        share = f"{100 * is_person[inside].mean():.0f} of {inside.sum()}"
        yield share if inside.any() else "-"


def _errors(run: EvaluationRun) -> Iterator[DetectionErrors]:
    """Yield the errors of all detections with a position and a covariance."""
    output = execute(run)
    detections, frames = {d.stamp_ns: d for d in output.detections}, output.matching.sequence.frames
    for frame in frames:
        if frame.stamp_ns in detections and frame.map_from_camera is not None:
            for person in detections[frame.stamp_ns].detections:
                yield from _error(person, frame, frame.map_from_camera)


def _error(found: Detection, frame: EvaluationFrame, pose: F64) -> Iterator[DetectionErrors]:
    position_m, variances = found.position_m, found.position_covariance_m2
    if position_m is None or variances is None:
        return
    person, truth = math.nan if found.person is None else found.person, frame.truth
    ray_m = (pose[:3, :3] @ position_m)[:2]
    true_m = np.zeros((0, 2)) if truth.positions_m is None else truth.positions_m[:, :2]
    offsets_m = pose[:2, 3] + ray_m - true_m
    distances_m = np.linalg.norm(offsets_m, axis=1)
    if not len(true_m) or distances_m.min() > NEAR_M:
        yield DetectionErrors(person, math.nan, math.nan, math.nan, math.nan, math.nan)
        return
    nearest = int(distances_m.argmin())
    along = ray_m / np.linalg.norm(ray_m)
    axes = np.array([[-along[1], along[0]], along])
    error, S = axes @ offsets_m[nearest], axes @ pose[:2, :3] @ variances @ pose[:2, :3].T @ axes.T
    yaw_rad = math.nan
    if found.heading is not None and truth.yaws_rad is not None:
        x, y, _ = pose[:3, :3] @ found.heading
        yaw_rad = math.remainder(math.atan2(y, x) - truth.yaws_rad[nearest], math.tau)
    sigma_rad = found.heading_sigma_rad or math.nan
    square = float(error @ np.linalg.solve(S, error))
    yaw_square, (across_m, along_m) = (yaw_rad / sigma_rad) ** 2, error.tolist()
    yield DetectionErrors(person, square, across_m, along_m, yaw_square, math.degrees(yaw_rad))
