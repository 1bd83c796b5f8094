"""Errors of the velocities of detections, before standing cameras, against their covariances."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.lib.table import markdown
from common.metrics.record import EvaluationFrame
from evaluation.methods import read_method
from evaluation.pool import Pool
from evaluation.recordings.recordings import EvaluationRecording
from evaluation.run.preparation import EvaluationPlan, runs_of
from evaluation.run.run import EvaluationRun, execute
from people4d.messages import F64, Detection

NEAR_M = 0.35  # maximum distance of a detection to its person on the ground [m]
CHI2_2DOF = {90: 4.605, 99: 9.210}  # share of errors [%] and squared distance of its ellipse
NOTE = """On the ground, before standing cameras. Errors of a surface that turns last 0.35 s, so the
variance of one frame is larger than its error, by the number of frames in that time (section 10 of
docs/method.md): more than 90 % are in the 90 % ellipse."""
HEADER = (
    "velocities",
    *(f"in the {share} % ellipse, %" for share in CHI2_2DOF),
    *("mean square / 2", "RMS across, along the ray m/s", "told m/s"),
)


def velocity_table(
    scenes: Mapping[tuple[str, str], Sequence[EvaluationRecording]], cache: Path, jobs: int
) -> str:
    """Return the normalised squared errors, by split and simulator.

    Detections of all scenes are in the cache.
    """
    rows = []
    for (split, simulator), recordings in scenes.items():
        plan = EvaluationPlan((read_method("best"),), tuple(recordings), cache, jobs)
        with Pool(jobs, lambda _stage, _share: None) as pool:
            errors = np.array([row for run in runs_of(plan, pool) for row in _errors(run)])
        if len(errors):
            rows.append([f"{simulator}, {split}, {len(errors)}", *_figures(errors)])
    return f"{NOTE}\n\n{markdown(HEADER, rows)}"


def _figures(errors: F64) -> Iterator[str]:
    squares = errors[:, 0]
    yield from (f"{100 * np.mean(squares < limit):.1f}" for limit in CHI2_2DOF.values())
    yield f"{squares.mean() / 2:.2f}"
    for part in (errors[:, 1:3], errors[:, 3:5]):
        yield ", ".join(f"{mps:.2f}" for mps in np.sqrt(np.mean(part**2, axis=0)))


def _errors(run: EvaluationRun) -> Iterator[list[float]]:
    """Yield normalised squares, errors and deviations across and along the ray of velocities."""
    output = execute(run)
    detections, frames = {d.stamp_ns: d for d in output.detections}, output.matching.sequence.frames
    poses = [one.map_from_camera for one in frames if one.map_from_camera is not None]
    if not poses or not np.allclose(poses[0], poses[-1]):
        return
    for frame in frames:
        for person in detections[frame.stamp_ns].detections if frame.stamp_ns in detections else ():
            yield from _error(person, frame, poses[0])


def _error(person: Detection, frame: EvaluationFrame, pose: F64) -> Iterator[list[float]]:
    truth, variances = frame.truth, person.velocity_covariance_m2ps2
    velocity_mps, position_m = person.velocity_mps, person.position_m
    if velocity_mps is None or position_m is None or variances is None or not truth.ids:
        return
    assert truth.positions_m is not None
    ray_m = (pose[:3, :3] @ position_m)[:2]
    distances_m = np.linalg.norm(truth.positions_m[:, :2] - pose[:2, 3] - ray_m, axis=1)
    nearest = int(distances_m.argmin())
    if truth.velocities_mps is None or distances_m[nearest] > NEAR_M:
        return
    along = ray_m / np.linalg.norm(ray_m)
    axes = np.array([[-along[1], along[0]], along])
    R = axes @ pose[:2, :3]
    error = R @ velocity_mps - axes @ truth.velocities_mps[nearest, :2]
    S = R @ variances @ R.T
    yield [float(error @ np.linalg.solve(S, error)), *error, *np.sqrt(S.diagonal())]
