"""Motion of a base from points in a keyframe and in a frame (docs/method.md section 18)."""

from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from services.visual_odometry.reprojection import (
    BaseMount,
    Flags,
    Indices,
    Matches,
    Reprojection,
    Reprojector,
)
from services.visual_odometry.twist import rotation_vectors, small_motions

ROOM_MIN = 4  # minimum number of inliers in the room
POINTS_MIN = 12  # minimum number of inliers
ROUNDS = 32  # number of random samples
SAMPLE = 3  # number of points of a random sample
SAMPLE_STEPS, STEPS = 2, 6  # Gauss-Newton steps of a sample, and of all points
SMALL_STEP = 1e-5  # maximum step of a converged solution [m, rad]
GATE_SIGMAS = 3.0  # gate of a point [standard deviations]
PRIOR_SIGMAS = 5.0  # gate of a motion around its prediction [standard deviations]
FIRST_GATE = 4.0  # widening of the gate in the first step
EASY_SHARE = 0.7  # minimum share of agreeing points of a fit without samples
HUBER = 1.5  # Huber's threshold [standard deviations]
PEOPLE_SIGMAS = 3.0  # maximum change of the motion by points on people [standard deviations]
SIGMA_FACTOR = 2.5  # inflation of the motion's standard deviation: close points are correlated
COMMON = 1.0  # share of the depth uncertainty that all points have in common (scale of the room)


@dataclass(frozen=True)
class MotionPrior:
    """Predicted motion."""

    before_from_now: F64  # 4x4
    covariance: F64  # KxK, covariance of the free entries of the error's twist


@dataclass(frozen=True)
class MotionFit:
    """Estimated motion of the base."""

    before_from_now: F64  # 4x4, the base now in the frame of the base then
    covariance: F64  # KxK, covariance of the free entries of the error's twist, frame: the base now
    # KxK, covariance from an error common to all depths. It is constant while a keyframe is used,
    # so it does not add to the motion from frame to frame
    common: F64
    inliers: Flags  # N, points that agree with the motion
    depth_errors: F64  # [1/m] N, estimated minus assumed inverse depths
    depth_sigmas: F64  # [1/m] N, standard deviations of the estimates


def fit_motion(matches: Matches, mount: BaseMount, prior: MotionPrior) -> MotionFit | None:
    """Return the most likely motion if enough points agree with it.

    A point of unknown depth counts across its epipolar line, and hardly along it. Points beyond
    the range of the sensor therefore determine rotation, and near points translation.

    Source: random samples [Fischler 1981], then Gauss-Newton on distances in the image with Huber's
    weights [Huber 1964]; docs/method.md section 18.
    """
    room = ~matches.people
    if room.sum() < ROOM_MIN or len(room) < POINTS_MIN:
        return None
    problem = _Problem(matches, mount, prior)
    solution = problem.solve(prior.before_from_now, room, FIRST_GATE)
    if (solution.off < GATE_SIGMAS)[room].mean() < EASY_SHARE:
        solution = problem.solve(problem.best_sample(), room, FIRST_GATE)
    if matches.people.any():
        solution = _with_people(problem, solution)
    pose, off = solution.pose, solution.off
    inliers = off < GATE_SIGMAS
    if inliers[room].sum() < ROOM_MIN or inliers.sum() < POINTS_MIN:
        return None
    if np.sqrt(problem.prior_cost(pose[None])[0]) > PRIOR_SIGMAS:
        return None
    # Residuals above the assumed noise inflate the covariance; residuals below never shrink it.
    spread = max(float(np.mean(off[inliers] ** 2)) / 2, 1.0) * SIGMA_FACTOR**2
    information = np.linalg.inv(prior.covariance)
    measured = np.linalg.inv(solution.inverse) - information
    covariance = np.linalg.inv(measured / spread + information)
    depths = problem.depths(pose, covariance)
    common = problem.common_error(pose, inliers, solution.inverse)
    return MotionFit(pose, covariance, common, inliers, *depths)


@dataclass(frozen=True)
class _Solution:
    pose: F64  # 4x4, the motion
    inverse: F64  # KxK, inverse of the normal matrix
    off: F64  # N, errors of points in standard deviations


def _with_people(problem: "_Problem", room: _Solution) -> _Solution:
    """Return the solution with points on people, if it agrees with the solution of the room."""
    both = problem.solve(room.pose, np.ones(len(room.off), np.bool_), 1.0)
    error = problem.twists_to(room.pose[None], both.pose)[0]
    return both if error @ np.linalg.solve(room.inverse, error) < PEOPLE_SIGMAS**2 else room


class _Problem:
    """Cost of a motion: reprojection errors, each with its covariance, and the prior."""

    def __init__(self, matches: Matches, mount: BaseMount, prior: MotionPrior) -> None:
        self._matches, self._free, self._prior = matches, mount.free, prior
        self._rays = Reprojector(matches, mount)
        self._information = np.linalg.inv(prior.covariance)
        self._all: Indices = np.arange(len(matches.then))[None]

    def solve(self, pose: F64, which: Flags, first_gate: float) -> _Solution:
        """Return the most likely motion near `pose` (4x4) by the points `which` (N flags).

        The gate of the first step is widened by `first_gate`, since `pose` may be a guess.
        """
        rays = self._rays.project_points(pose[None], self._all)
        for step in range(STEPS):
            gate = GATE_SIGMAS * (first_gate if step == 0 else 1.0)
            off = np.sqrt(self._rays.cost(rays, self._all))
            weights = np.where((off < gate) & which, HUBER / np.maximum(off, HUBER), 0.0)
            twist, inverse = self._step(pose[None], self._all, weights, rays)
            pose = pose @ small_motions(twist)[0]
            rays = self._rays.project_points(pose[None], self._all)
            if np.abs(twist).max() < SMALL_STEP:
                break
        return _Solution(pose, inverse[0], np.sqrt(self._rays.cost(rays, self._all))[0])

    def depths(self, pose: F64, covariance: F64) -> tuple[F64, F64]:
        """Return the errors of inverse depths (N) given a motion, and their sigmas (N)."""
        rays = self._rays.project_points(pose[None], self._all)
        length = np.maximum(np.linalg.norm(rays.by_depth[0], axis=1), 1e-9)
        along = rays.by_depth[0] / length[:, None]
        by_twist = np.einsum("ni,nik->nk", along, self._rays.by_twist(rays, self._all)[0])
        by_motion = np.einsum("nk,kl,nl->n", by_twist, covariance, by_twist)
        errors = -np.einsum("ni,ni->n", along, rays.off[0]) / length
        return errors, np.sqrt(self._matches.noise**2 + by_motion) / length

    def common_error(self, pose: F64, inliers: Flags, inverse: F64) -> F64:
        """Return the covariance (KxK) of a motion from an error common to all depths."""
        rays = self._rays.project_points(pose[None], self._all)
        blind = (rays.by_depth[..., None, :] @ self._rays.by_twist(rays, self._all))[0, :, 0]
        length = (rays.by_depth[0] ** 2).sum(axis=-1)
        counts = inliers / self._matches.noise**2
        counts = counts * (1 - self._rays.along(rays, self._all)[0] * length)
        shift = inverse @ ((COMMON * self._matches.sigmas * counts) @ blind)
        return np.outer(shift, shift)

    def best_sample(self) -> F64:
        """Return the motion (4x4) of the random sample with the minimum truncated cost."""
        count = len(self._matches.then)
        room = np.flatnonzero(~self._matches.people)
        chosen = room[np.random.default_rng(0).integers(0, len(room), (ROUNDS, SAMPLE))]
        poses = np.repeat(self._prior.before_from_now[None], ROUNDS, axis=0)
        for _ in range(SAMPLE_STEPS):
            rays = self._rays.project_points(poses, chosen)
            twist, _ = self._step(poses, chosen, np.ones(chosen.shape), rays)
            poses = poses @ small_motions(twist)
        poses = np.concatenate([self._prior.before_from_now[None], poses])
        everything = np.broadcast_to(np.arange(count), (len(poses), count))
        cost = self._rays.cost(self._rays.project_points(poses, everything), everything)
        total = np.minimum(cost, GATE_SIGMAS**2).sum(axis=1) + self.prior_cost(poses)
        return np.asarray(poses[total.argmin()], np.float64)

    def _step(
        self, poses: F64, chosen: Indices, weights: F64, rays: Reprojection
    ) -> tuple[F64, F64]:
        """Return a Gauss-Newton step (Hx6) from H motions, and the inverse of its matrix (HxKxK).

        Points (indices HxM) have weights (HxM) and rays after the motions (Hx4x4).
        """
        weights = np.where(rays.front, weights, 0.0) / self._matches.noise[chosen] ** 2
        along = self._rays.along(rays, chosen)
        # S^-1 = (I - along j j') / sigma^2: errors along the epipolar line do not count.
        jacobian = self._rays.by_twist(rays, chosen)
        blind = (rays.by_depth[..., None, :] @ jacobian)[..., 0, :]
        off_blind = (rays.by_depth * rays.off).sum(axis=-1) * along
        flat = (*jacobian.shape[:1], -1, jacobian.shape[-1])
        weighted = (weights[..., None, None] * jacobian).reshape(flat).swapaxes(1, 2)
        blinded = (weights * along)[..., None] * blind
        normal = weighted @ jacobian.reshape(flat) - blinded.swapaxes(1, 2) @ blind
        side = (weighted @ rays.off.reshape(*flat[:2], 1))[..., 0]
        side -= ((weights * off_blind)[:, None] @ blind)[:, 0]
        inverse = np.linalg.inv(normal + self._information)
        pull = self.twists_to(poses, self._prior.before_from_now) @ self._information
        twist = np.zeros((len(poses), 6))
        twist[:, self._free] = (inverse @ (pull - side)[..., None])[..., 0]
        return twist, inverse

    def prior_cost(self, poses: F64) -> F64:
        twists = self.twists_to(poses, self._prior.before_from_now)
        return np.asarray(np.einsum("hi,ij,hj->h", twists, self._information, twists))

    def twists_to(self, poses: F64, end: F64) -> F64:
        """Return the twists (HxK) from motions (Hx4x4) to the motion `end` (4x4)."""
        rotations = np.einsum("hji,hjk->hik", poses[:, :3, :3], end[None, :3, :3])
        apart = end[:3, 3] - poses[:, :3, 3]
        shift = np.einsum("hji,hj->hi", poses[:, :3, :3], apart)
        turn = rotation_vectors(rotations)
        return np.asarray(np.concatenate([shift, turn], axis=1)[:, self._free])
