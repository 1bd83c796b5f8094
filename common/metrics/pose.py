"""Errors of position, velocity and yaw of the matched people (docs/method.md, section 9)."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from common.metrics.record import BOOL, EvaluationFrame, FrameMatches
from people4d.messages import F64

POSITION_LIMITS_M = (0.15, 0.3, 0.5)
VELOCITY_LIMITS_MPS = (0.15, 0.3, 0.5)
YAW_LIMITS_DEG = (30, 45, 90)


@dataclass(frozen=True)
class PoseErrors:
    """Estimate minus truth of K matches; unknown values are NaN and ignored by the figures."""

    position_m: F64  # [m] Kx2: x, y
    velocity_mps: F64  # [m/s] Kx2: x, y
    yaw_true_rad: F64  # [rad] K
    yaw_estimated_rad: F64  # [rad] K
    camera_axis: F64  # Kx2, unit: optical axis on the ground
    predicted: BOOL  # K, True if the track has no measurement in this frame
    occluded: BOOL  # K, True if the person is occluded

    def __add__(self, other: "PoseErrors") -> "PoseErrors":
        """Pool the matches of both."""
        return pool([self, other])

    def select(self, wanted: BOOL) -> "PoseErrors":
        """Return some of the matches (mask of K)."""
        return PoseErrors(**{f.name: getattr(self, f.name)[wanted] for f in fields(self)})

    @property
    def yaw_error_rad(self) -> F64:
        """Orientation error (K), 0 to pi: min(|e|, 2 pi - |e|)."""
        error = np.abs(self.yaw_estimated_rad - self.yaw_true_rad) % (2 * np.pi)
        return np.minimum(error, 2 * np.pi - error)

    def along_across(self, errors: F64) -> F64:
        """Rotate errors (Kx2: x, y) to the camera's axis: along it, and across to its left."""
        ax, ay = self.camera_axis.T
        x, y = errors.T
        return np.column_stack([x * ax + y * ay, y * ax - x * ay])

    def yaw_correlation(self) -> float | None:
        """Mardia's circular correlation: both roots are the number of matches, so mean cos(e)."""
        known = _known(self.yaw_error_rad)
        return float(np.cos(known).mean()) if len(known) else None

    def row(self) -> dict[str, float | None]:
        """Return all figures; None if no match has the quantity."""
        yaw_error_deg = np.degrees(self.yaw_error_rad)
        row: dict[str, float | None] = {"poses": len(self.position_m)}
        for name, errors, unit in (
            ("position", self.position_m, "m"),
            ("velocity", self.velocity_mps, "mps"),
        ):
            axes = np.column_stack([errors, self.along_across(errors)])
            for axis, values in zip(("x", "y", "along", "across"), axes.T, strict=True):
                row[f"{name}_rmse_{axis}_{unit}"] = rmse(values)
        row["yaw_rmse_deg"] = rmse(yaw_error_deg)
        row["yaw_correlation"] = self.yaw_correlation()
        row["yaw_reported"] = within(np.isnan(self.yaw_estimated_rad).astype(np.float64), 0.0)
        position_m = np.linalg.norm(self.position_m, axis=1)
        velocity_mps = np.linalg.norm(self.velocity_mps, axis=1)
        row |= {f"position_within_{n}_m": within(position_m, n) for n in POSITION_LIMITS_M}
        row |= {f"velocity_within_{n}_mps": within(velocity_mps, n) for n in VELOCITY_LIMITS_MPS}
        return row | {f"yaw_within_{n}_deg": within(yaw_error_deg, n) for n in YAW_LIMITS_DEG}


def rmse(errors: F64) -> float | None:
    """Return the root mean square of the known errors, None if there is none."""
    known = _known(errors)
    return float(np.sqrt(np.mean(known**2))) if len(known) else None


def within(errors: F64, limit: float) -> float | None:
    """Return the share of the known errors (>= 0) up to a limit, None if there is none."""
    known = _known(errors)
    return float(np.mean(known <= limit)) if len(known) else None


def pool(parts: Sequence[PoseErrors]) -> PoseErrors:
    """Pool the matches of several parts; an empty list gives an empty record."""
    two, one, no = np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.bool_)
    empty = PoseErrors(two, two, one, one, two, no, no)
    columns = [[getattr(p, f.name) for p in (empty, *parts)] for f in fields(PoseErrors)]
    return PoseErrors(*map(np.concatenate, columns))


def frame_errors(frame: EvaluationFrame, matches: FrameMatches) -> PoseErrors:
    """Return the errors of the pairs in view; none if truth or hypotheses have no positions."""
    truth, tracks = frame.truth, frame.hypotheses
    if truth.positions_m is None or tracks.positions_m is None:
        return pool([])
    in_view = truth.in_view[matches.rows]
    i, j = matches.rows[in_view], matches.columns[in_view]
    n, m = len(truth.ids), len(tracks.ids)
    velocity_mps = _rows(tracks.velocities_mps, m, 3)[j] - _rows(truth.velocities_mps, n, 3)[i]
    return PoseErrors(
        position_m=(tracks.positions_m[j] - truth.positions_m[i])[:, :2],
        velocity_mps=velocity_mps[:, :2],
        yaw_true_rad=_rows(truth.yaws_rad, n)[i],
        yaw_estimated_rad=_rows(tracks.yaws_rad, m)[j],
        camera_axis=np.tile(_axis(frame.map_from_camera), (len(i), 1)),
        predicted=tracks.was_predicted[j],
        occluded=~truth.required[i],
    )


def _axis(map_from_camera: F64 | None) -> F64:
    """Return the optical axis on the ground, NaN if unknown or straight up or down."""
    axis = np.zeros(2) if map_from_camera is None else map_from_camera[:2, 2]
    length = float(np.linalg.norm(axis))
    return axis / length if length > 1e-6 else np.full(2, np.nan)


def _rows(column: F64 | None, n: int, *width: int) -> F64:
    return np.full((n, *width), np.nan) if column is None else column


def _known(values: F64) -> F64:
    return values[np.isfinite(values)]
