"""Motion of people: simulated once in fixed steps, then interpolated at any time.

A motion is a pure function of plans, skeletons, duration and seed.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from common.geometry.transforms import transform_from
from lab.bodies.skeleton import SEGMENTS, BodyPose, Skeleton
from lab.motion.bouts import WalkPath
from lab.motion.crowd import CrowdPaths, Disc, PositionFunction, Surroundings, simulate_paths
from lab.motion.footfalls import Individual, StepPlan
from lab.motion.kinematics import pose_arrays
from lab.motion.walker import STEP_S, Walker
from lab.motion.wheelchair import roll
from lab.scenario import PersonPlan
from people4d.messages import F64

BEFORE_S, AFTER_S = 1.5, 3.5  # simulated time before the start, and after the end, for whole steps
ANYWHERE_M: F64 = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
SMOOTH_S = 0.08  # time constant of the smoothing of paths by the body's inertia [s]


class PersonMotion:
    """Motion of one person.

    Attributes:
        feet: Stances of the left and the right foot.
    """

    def __init__(self, path: WalkPath, pelvis_m: F64, rotations: F64, steps: StepPlan):
        self._begin_s = float(path.times_s[0])
        self._path = np.stack([path.x_m, path.y_m, path.yaw_rad], axis=-1)
        # Two columns make a rotation; the third is their cross product.
        axes = rotations[..., :2].reshape(len(pelvis_m), -1)
        self._samples = np.concatenate([pelvis_m, axes], axis=-1)
        self.feet = steps.feet

    def at(self, t_s: float) -> BodyPose:
        """Return the pose at a time; position and rotations have smooth derivatives."""
        values = self._interpolate(self._samples, np.array([t_s]))[0]
        axes = values[3:].reshape(len(SEGMENTS), 3, 2)
        x, y = axes[..., 0], axes[..., 1]
        x = x / np.linalg.norm(x, axis=-1, keepdims=True)
        z = np.cross(x, y)
        z /= np.linalg.norm(z, axis=-1, keepdims=True)
        rotations = np.stack([x, np.cross(z, x), z], axis=-1)
        pelvis = transform_from(values[:3], rotations[0])
        rotations[0] = np.eye(3)
        return BodyPose(pelvis, rotations)

    def path(self, t_s: npt.ArrayLike) -> F64:
        """Return the path without oscillation of the body at T times: Tx3 x, y [m], yaw [rad]."""
        return self._interpolate(self._path, np.atleast_1d(np.asarray(t_s, np.float64)))

    def path_yaw(self, t_s: float) -> float:
        """Return the direction of the path [rad], frame: map, not wrapped."""
        return float(self.path(t_s)[0, 2])

    def _interpolate(self, samples: F64, t_s: F64) -> F64:
        at = np.clip((t_s - self._begin_s) / STEP_S, 1.0, len(samples) - 2.0 - 1e-9)
        index = np.floor(at).astype(np.intp)
        s = (at - index)[:, None]
        before, left, right, after = (samples[index + k] for k in (-1, 0, 1, 2))
        cubic = s * (3 * (left - right) + after - before)
        square = s * (2 * before - 5 * left + 4 * right - after + cubic)
        return np.asarray(left + 0.5 * s * (right - before + square))


def simulate(
    people: Sequence[PersonPlan],
    skeletons: Sequence[Skeleton],
    duration_s: float,
    seed: int,
    obstacle: PositionFunction | None = None,
    area_m: F64 = ANYWHERE_M,
    discs: Sequence[Disc] = (),
) -> tuple[PersonMotion, ...]:
    """Return the motions of people by their plans, with collision avoidance.

    Args:
        people: Plans of the people.
        skeletons: Skeletons of the people.
        duration_s: Duration of the scenario; motions last 1 s longer at both ends.
        seed: Seed of individual differences and of sway.
        obstacle: Position of a moving obstacle, such as the robot, at a time from -2 s on: x, y and
            optionally more [m], frame: map.
        area_m: 2x2, lower and upper corner of the free floor, frame: map.
        discs: Static obstacles: x, y and radius [m], frame: map.
    """
    steps = round((duration_s + BEFORE_S + AFTER_S) / STEP_S) + 1
    times_s: F64 = np.arange(steps, dtype=np.float64) * STEP_S - BEFORE_S
    walkers = [
        Walker(plan, skeleton.stature_m) for plan, skeleton in zip(people, skeletons, strict=True)
    ]
    stools_m = [waypoint.to for plan in people for waypoint in plan.path if waypoint.sit]
    around = Surroundings(area_m, stools_m, obstacle, discs)
    paths = simulate_paths(walkers, times_s, around)
    drawn = [
        Individual.draw(skeleton, seed, index, plan)
        for index, (skeleton, plan) in enumerate(zip(skeletons, people, strict=True))
    ]
    return tuple(_motion(paths, index, person) for index, person in enumerate(drawn))


def _motion(paths: CrowdPaths, index: int, person: Individual) -> PersonMotion:
    x, y, yaw = (
        gaussian_filter1d(values[index], SMOOTH_S / STEP_S, mode="nearest")
        for values in (paths.x_m, paths.y_m, paths.yaw_rad)
    )
    speed = np.hypot(np.gradient(x, STEP_S), np.gradient(y, STEP_S))
    path = WalkPath(paths.times_s, x, y, yaw, speed, np.gradient(yaw, STEP_S))
    looking = paths.looking[index]
    pelvis_m, rotations, steps = (
        roll(person, path, looking)
        if person.plan.wheelchair
        else pose_arrays(person, path, paths.seated[index], looking)
    )
    return PersonMotion(path, pelvis_m, rotations, steps)
