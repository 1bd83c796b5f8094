"""The gait of the people before one camera: from what is seen in it to points in a fixed frame."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from people4d.messages import F32, F64, U8, U16, BodyPoint, CameraInfo, PersonGait
from services.gait.cascade import Cascade, GaitEstimate, Seen
from services.gait.config import GaitConfig
from services.gait.points.depth_layer import PointEstimate
from services.gait.points.points import LEFT_FOOT, RIGHT_FOOT
from services.gait.steps.steps import StepMeter

FAR_PX = 1e6  # a box that is farther off is nowhere
UP = np.array([0.0, 0.0, 1.0])  # of every frame that is fixed
COUNTERS = ("over_budget", "wrong_size", "stale", "clock_resets")


@dataclass(frozen=True)
class Scene:
    """What is to be seen in one frame.

    Args:
        stamp_ns: Time of the frame.
        rgb: HxWx3, red first.
        depth_mm: HxW; 0: unknown.
        seen: What is known of each person.
        fixed_from_optical: 4x4, where the camera is, in a frame that stands still, z up.
    """

    stamp_ns: int
    rgb: U8
    depth_mm: U16
    seen: Sequence[Seen]
    fixed_from_optical: F64


@dataclass(frozen=True)
class Found:
    """One person in one frame: as the filters tell them, and as others are told."""

    estimate: GaitEstimate
    person: PersonGait


class People:
    """Follows the people before one camera.

    Args:
        config: The configuration.
        info: Calibration of the camera.
        counters: Counts COUNTERS.
    """

    def __init__(self, config: GaitConfig, info: CameraInfo, counters: Counter[str]) -> None:
        self._config, self._info, self._counters = config, info, counters
        self._cascade = Cascade(config.cascade, info)
        self._meters: dict[int, StepMeter] = {}
        self._last: Scene | None = None

    def update(self, scene: Scene) -> list[Found] | None:
        """Return the people of a frame, nearest first; None if the frame is of no use."""
        if scene.rgb.shape[:2] != (self._info.height, self._info.width):
            self._counters["wrong_size"] += 1
            return None
        if self._last and scene.stamp_ns <= self._last.stamp_ns:
            if self._last.stamp_ns - scene.stamp_ns <= self._config.clock_jump_s * 1e9:
                self._counters["stale"] += 1
                return None
            self._counters["clock_resets"] += 1
            self._restart()
        chosen = self._choose(scene.seen)
        estimates = self._cascade.update(scene.stamp_ns, scene.rgb, scene.depth_mm, chosen)
        self._counters["over_budget"] += sum(not one.fresh for one in estimates)
        found = [Found(one, self._told(one, scene)) for one in estimates]
        followed = {one.id for one in chosen}
        self._meters = {key: meter for key, meter in self._meters.items() if key in followed}
        self._last = scene
        return found

    def _restart(self) -> None:
        self._cascade = Cascade(self._config.cascade, self._info)
        self._meters, self._last = {}, None

    def _choose(self, seen: Sequence[Seen]) -> list[Seen]:
        """Return whom there is time for; who is not seen in this frame is only followed on."""
        here = [one for one in seen if one.box_xyxy_px is not None or one.id in self._meters]
        nearest = sorted(here, key=lambda one: np.inf if one.depth_m is None else one.depth_m)
        self._counters["over_budget"] += max(len(nearest) - self._config.people_max, 0)
        return nearest[: self._config.people_max]

    def _told(self, estimate: GaitEstimate, scene: Scene) -> PersonGait:
        motion = self._motion(scene)
        points = {
            name: fixed_point(name, point, scene.fixed_from_optical, motion)
            for name, point in estimate.points.items()
        }
        meter = self._meters.setdefault(estimate.id, StepMeter(self._config.steps, UP))
        left, right = (
            point.position_m if (point := points.get(foot)) and point.state == "measured" else None
            for foot in (LEFT_FOOT, RIGHT_FOOT)
        )
        return PersonGait(
            id=estimate.id,
            points=tuple(point for point in points.values() if point),
            measures=meter.update(scene.stamp_ns / 1e9, left, right),
            box_xyxy_px=_box(estimate),
        )

    def _motion(self, scene: Scene) -> F64:
        """Return how fast the camera's pose changes, 4x4, a second."""
        if self._last is None:
            return np.zeros((4, 4))
        dt_s = (scene.stamp_ns - self._last.stamp_ns) / 1e9
        return np.asarray((scene.fixed_from_optical - self._last.fixed_from_optical) / dt_s)


def _box(estimate: GaitEstimate) -> F32 | None:
    box = estimate.box_xyxy_px
    return None if box is None else np.clip(box, -FAR_PX, FAR_PX).astype(np.float32)


def fixed_point(name: str, point: PointEstimate, pose: F64, motion: F64) -> BodyPoint | None:
    """Return a point in the fixed frame, None where it is not known.

    Args:
        name: Its name.
        point: In the optical frame.
        pose: 4x4, fixed_from_optical.
        motion: 4x4, its change in a second: a point that rests in the image of a camera that moves
            does not rest.
    """
    turn, here = pose[:3, :3], np.append(point.position_m, 1.0)
    turns = np.kron(np.eye(2), turn)
    covariance = turns @ point.covariance @ turns.T
    position, velocity = (pose @ here)[:3], turn @ point.velocity_mps + (motion @ here)[:3]
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
