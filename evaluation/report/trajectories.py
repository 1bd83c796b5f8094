"""The course of a trial as arrays: what was true and what was told, over time."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np

from common.metrics.record import BOOL, I64
from evaluation.run.run import RunOutput
from people4d.messages import F64

X, Y, VX, VY, YAW = range(5)  # columns


@dataclass(frozen=True)
class CameraCoverage:
    """What the camera covers, seen from above, in the frame of truth.

    Args:
        position_m: 2.
        axis_rad: Where it looks.
        half_angle_rad: Half of its horizontal field of view.
        range_m: Depth range.
    """

    position_m: F64
    axis_rad: float
    half_angle_rad: float
    range_m: float


@dataclass(frozen=True)
class RunTrajectories:
    """One method on one take: N frames, K people.

    Args:
        method: Name of the method.
        stamps_s: N, since the first frame.
        persons: K identities.
        true: NxKx5, see the columns X to YAW; NaN where unknown.
        counted: NxK, who had to be found.
        told: NxKx5, the same of the track that each person is matched to; NaN where none is.
        tracks: NxK, its identity; 0: none.
        paths: By identity of a track, Lx6: seconds, then the columns.
        switches_s: When a person got another track.
        camera: At the first frame; None: unknown, or it moves.
    """

    method: str
    stamps_s: F64
    persons: tuple[str, ...]
    true: F64
    counted: BOOL
    told: F64
    tracks: I64
    paths: Mapping[int, F64]
    switches_s: tuple[float, ...]
    camera: CameraCoverage | None


def trajectories_of(method: str, done: RunOutput) -> RunTrajectories:
    """Return the course of a run."""
    matching, sequence = done.matching, done.matching.sequence
    shape = (len(sequence.frames), len(matching.persons))
    true, told = np.full((*shape, 5), np.nan), np.full((*shape, 5), np.nan)
    counted, tracks = np.zeros(shape, np.bool_), np.zeros(shape, np.int64)
    paths: dict[int, list[F64]] = {}
    for row, (frame, step) in enumerate(zip(sequence.frames, matching.frame_matches, strict=True)):
        here, there = _columns(frame.truth), _columns(frame.hypotheses)
        true[row, step.persons] = here
        counted[row, step.persons] = step.required
        told[row, step.persons[step.rows]] = there[step.columns]
        ids = np.array(frame.hypotheses.ids, np.int64)
        tracks[row, step.persons[step.rows]] = ids[step.columns]
        for identity, values in zip(ids.tolist(), there, strict=True):
            paths.setdefault(identity, []).append(np.append(sequence.stamps_s[row], values))
    return RunTrajectories(
        method=method,
        stamps_s=sequence.stamps_s,
        persons=tuple(map(str, matching.persons)),
        true=true,
        counted=counted,
        told=told,
        tracks=tracks,
        paths={identity: np.array(path) for identity, path in paths.items()},
        switches_s=tuple(float(sequence.stamps_s[s.frame]) for s in matching.id_switches),
        camera=_camera(done),
    )


def _columns(people: object) -> F64:
    """Return Nx5 of people who have positions, velocities and yaws."""
    positions_m = cast(F64, getattr(people, "positions_m", None))
    velocities_mps = cast(F64, getattr(people, "velocities_mps", None))
    yaws_rad = cast(F64, getattr(people, "yaws_rad", None))
    return np.column_stack([positions_m[:, :2], velocities_mps[:, :2], yaws_rad])


def _camera(done: RunOutput) -> CameraCoverage | None:
    frames = done.matching.sequence.frames
    poses = [frame.map_from_camera for frame in (frames[0], frames[-1])] if frames else []
    if not poses or poses[0] is None or poses[-1] is None or not np.allclose(poses[0], poses[-1]):
        return None
    axis, info = poses[0][:2, 2], done.info
    return CameraCoverage(
        position_m=poses[0][:2, 3],
        axis_rad=float(np.arctan2(axis[1], axis[0])),
        half_angle_rad=float(np.arctan(info.width / 2 / info.fx)),
        range_m=info.max_depth_m,
    )
