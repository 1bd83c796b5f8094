"""Trajectories of a run as arrays: ground truth and tracks over time."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from common.metrics.record import BOOL, I64, PeopleColumns
from evaluation.run.run import RunOutput
from people4d.messages import F64

X, Y, VX, VY, YAW = range(5)  # columns


@dataclass(frozen=True)
class CameraCoverage:
    """Field of view of the camera from above, in the frame of the truth."""

    position_m: F64  # 2
    axis_rad: float  # [rad] direction of the optical axis
    half_angle_rad: float  # [rad] half of the horizontal field of view
    range_m: float  # [m] maximum depth


@dataclass(frozen=True)
class RunTrajectories:
    """One method on one recording: N frames, K people."""

    method: str
    stamps_s: F64  # N, time since the first frame
    persons: tuple[str, ...]  # K identities
    true: F64  # NxKx5, see the columns X to YAW; NaN where unknown
    required: BOOL  # NxK, people to be tracked
    tracked: F64  # NxKx5, same columns of the matched track; NaN if unmatched
    tracks: I64  # NxK, identity of the matched track; 0: none
    paths: Mapping[int, F64]  # Lx6 by identity of a track: time [s], then the columns
    switches_s: tuple[float, ...]  # times of ID switches
    camera: CameraCoverage | None  # view at the first frame; None: unknown or moving


def trajectories_of(method: str, output: RunOutput) -> RunTrajectories:
    """Return the trajectories of a run."""
    matching, sequence = output.matching, output.matching.sequence
    shape = (len(sequence.frames), len(matching.persons))
    true, tracked = np.full((*shape, 5), np.nan), np.full((*shape, 5), np.nan)
    required, tracks = np.zeros(shape, np.bool_), np.zeros(shape, np.int64)
    paths: dict[int, list[F64]] = {}
    for row, (frame, step) in enumerate(zip(sequence.frames, matching.frame_matches, strict=True)):
        people, estimates = _columns(frame.truth), _columns(frame.hypotheses)
        true[row, step.persons] = people
        required[row, step.persons] = step.required
        tracked[row, step.persons[step.rows]] = estimates[step.columns]
        ids = np.array(frame.hypotheses.ids, np.int64)
        tracks[row, step.persons[step.rows]] = ids[step.columns]
        for identity, values in zip(ids.tolist(), estimates, strict=True):
            paths.setdefault(identity, []).append(np.append(sequence.stamps_s[row], values))
    return RunTrajectories(
        method=method,
        stamps_s=sequence.stamps_s,
        persons=tuple(map(str, matching.persons)),
        true=true,
        required=required,
        tracked=tracked,
        tracks=tracks,
        paths={identity: np.array(path) for identity, path in paths.items()},
        switches_s=tuple(float(sequence.stamps_s[s.frame]) for s in matching.id_switches),
        camera=_camera(output),
    )


def _columns(people: PeopleColumns) -> F64:
    """Return the columns (Nx5) of N people."""
    columns = (people.positions_m, people.velocities_mps, people.yaws_rad)
    positions_m, velocities_mps, yaws_rad = (c for c in columns if c is not None)
    return np.column_stack([positions_m[:, :2], velocities_mps[:, :2], yaws_rad])


def _camera(output: RunOutput) -> CameraCoverage | None:
    frames = output.matching.sequence.frames
    poses = [frame.map_from_camera for frame in (frames[0], frames[-1])] if frames else []
    if not poses or poses[0] is None or poses[-1] is None or not np.allclose(poses[0], poses[-1]):
        return None
    axis, info = poses[0][:2, 2], output.info
    return CameraCoverage(
        position_m=poses[0][:2, 3],
        axis_rad=float(np.arctan2(axis[1], axis[0])),
        half_angle_rad=float(np.arctan(info.width / 2 / info.fx)),
        range_m=info.max_depth_m,
    )
