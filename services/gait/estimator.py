"""Gait of the people before one camera: from observations to points in a fixed frame and steps."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64, U8, U16, BodyPoint, CameraInfo, PersonGait
from services.gait.cascade import Cascade, GaitEstimate, PersonObservation
from services.gait.config import GaitConfig
from services.gait.points.keypoints import HEAD, LEFT_FOOT, RIGHT_FOOT
from services.gait.points.point_filter import PointEstimate
from services.gait.steps.step_meter import PointSample, StepMeter

BOX_MAX_PX = 1e6  # Maximum coordinate of published boxes [px]
CLOCK_JUMP_S = 1.0  # Minimum step back of the stamps that resets the estimator [s]
ESTIMATOR_COUNTERS = ("over_budget", "wrong_size", "stale", "clock_resets")


@dataclass(frozen=True)
class GaitFrame:
    """RGB-D frame with observations of people and the camera's pose."""

    stamp_ns: int
    rgb: U8  # HxWx3, red first
    depth_mm: U16  # HxW; 0: no reading
    observations: Sequence[PersonObservation]
    fixed_from_optical: F64  # 4x4, pose of the camera in a fixed frame, z up


@dataclass(frozen=True)
class GaitResult:
    """One person in one frame: estimate of the cascade, and the published record."""

    estimate: GaitEstimate
    person: PersonGait


OnFrame = Callable[[CameraInfo, GaitFrame, Sequence[GaitResult]], None]


class GaitEstimator:
    """Estimates the gait of the people before one camera; counts ESTIMATOR_COUNTERS."""

    def __init__(self, config: GaitConfig, info: CameraInfo, counters: Counter[str]) -> None:
        self._config, self._info, self._counters = config, info, counters
        self._cascade = Cascade(config.cascade, info)
        self._meters: dict[int, StepMeter] = {}
        self._last: GaitFrame | None = None

    def update_people(self, frame: GaitFrame) -> list[GaitResult] | None:
        """Return the people of a frame, nearest first; None if the frame is not usable."""
        if frame.rgb.shape[:2] != (self._info.height, self._info.width):
            self._counters["wrong_size"] += 1
            return None
        if self._last and frame.stamp_ns <= self._last.stamp_ns:
            if self._last.stamp_ns - frame.stamp_ns <= CLOCK_JUMP_S * 1e9:
                self._counters["stale"] += 1
                return None
            self._counters["clock_resets"] += 1
            self._reset()
        chosen = self._choose(frame.observations)
        estimates = self._cascade.update_people(
            frame.stamp_ns, frame.rgb, frame.depth_mm, chosen, frame.fixed_from_optical
        )
        results = [GaitResult(one, self._person_gait(one, frame)) for one in estimates]
        ids = {one.id for one in chosen}
        self._meters = {key: meter for key, meter in self._meters.items() if key in ids}
        self._last = frame
        return results

    def _reset(self) -> None:
        self._cascade = Cascade(self._config.cascade, self._info)
        self._meters, self._last = {}, None

    def _choose(self, observations: Sequence[PersonObservation]) -> list[PersonObservation]:
        """Return the nearest people; undetected ones only if they are already tracked."""
        here = [
            one for one in observations if one.box_xyxy_px is not None or one.id in self._meters
        ]
        nearest = sorted(here, key=lambda one: np.inf if one.depth_m is None else one.depth_m)
        self._counters["over_budget"] += max(len(nearest) - self._config.people_max, 0)
        return nearest[: self._config.people_max]

    def _person_gait(self, estimate: GaitEstimate, frame: GaitFrame) -> PersonGait:
        motion = self._camera_motion(frame)
        points = {
            name: to_fixed_frame(name, point, frame.fixed_from_optical, motion)
            for name, point in estimate.points.items()
        }
        meter = self._meters.setdefault(estimate.id, StepMeter(self._config.steps))
        body, left, right = (
            PointSample(point.position_m, point.covariance[:3, :3])
            if (point := points.get(name)) and point.state != "lost"
            else None
            for name in (HEAD, LEFT_FOOT, RIGHT_FOOT)
        )
        box = estimate.box_xyxy_px
        box = None if box is None else np.clip(box, -BOX_MAX_PX, BOX_MAX_PX)
        return PersonGait(
            id=estimate.id,
            points=tuple(point for point in points.values() if point),
            measures=meter.add_frame(frame.stamp_ns / 1e9, body, left, right),
            box_xyxy_px=None if box is None else box.astype(np.float32),
        )

    def _camera_motion(self, frame: GaitFrame) -> F64:
        """Return the time derivative of the camera's pose, 4x4, 1/s."""
        if self._last is None:
            return np.zeros((4, 4))
        dt_s = (frame.stamp_ns - self._last.stamp_ns) / 1e9
        return np.asarray((frame.fixed_from_optical - self._last.fixed_from_optical) / dt_s)


def to_fixed_frame(name: str, point: PointEstimate, pose: F64, motion: F64) -> BodyPoint | None:
    """Return a point of the optical frame in the fixed frame, None if it was never measured.

    The velocity includes the motion of the camera, the time derivative (4x4) of its pose.
    """
    rotation, here = pose[:3, :3], np.append(point.position_m, 1.0)
    rotations = np.kron(np.eye(2), rotation)
    covariance = rotations @ point.covariance @ rotations.T
    position = (pose @ here)[:3]
    velocity = rotation @ point.velocity_mps + (motion @ here)[:3]
    if not all(np.isfinite(value).all() for value in (position, velocity, covariance)):
        return None
    return BodyPoint(
        name=name,
        state=point.state,
        position_m=position,
        velocity_mps=velocity,
        covariance=(covariance + covariance.T) / 2,
        confidence=float(np.clip(point.confidence, 0.0, 1.0)),
    )
