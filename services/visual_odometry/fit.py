"""Motion of a base from points in a keyframe and in a frame (docs/method.md section 18)."""

from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from services.visual_odometry.config import FitConfig
from services.visual_odometry.reprojection import (
    BaseMount,
    Flags,
    Indices,
    Matches,
    Reprojection,
    Reprojector,
)
from services.visual_odometry.twist import rotation_vectors, small_motions

SAMPLE = 3  # points of a random sample
SAMPLE_STEPS, STEPS = 2, 6
SMALL_STEP = 1e-5  # [m, rad]
COMMON = 1.0  # of the sigma of depths that is common to all: the scale of a room
PEOPLE_SIGMAS = 3.0  # standard deviations that people may change the motion by the room
FIRST_GATE = 4.0  # of the gate, at the first step
EASY_SHARE = 0.7  # of the points agree: no samples are needed
HUBER = 1.5  # standard deviations from which on a point counts less


@dataclass(frozen=True)
class MotionPrior:
    """Prediction of a motion."""

    before_from_now: F64  # 4x4, the likeliest
    covariance: F64  # KxK, of the free entries of the twist by which it may be off


@dataclass(frozen=True)
class MotionFit:
    """A motion of the base."""

    before_from_now: F64  # 4x4, the base now in the frame of the base then
    covariance: F64  # KxK, of the free entries of the twist of the error, frame: the base now
    # KxK, likewise, of a common error of all depths. It stays as long as the keyframe, so that it
    # is none of the motion from frame to frame
    common: F64
    inliers: Flags  # N, points that agree
    depth_errors: F64  # [1/m] N, estimated less assumed inverse depths
    depth_sigmas: F64  # [1/m] N, standard deviations of these


def fit_motion(
    matches: Matches, mount: BaseMount, prior: MotionPrior, config: FitConfig
) -> MotionFit | None:
    """Return the likeliest motion, if enough points agree on it.

    A point of unknown depth is hardly informative along the line on which its depth would move it,
    and fully across; so points too far for the sensor give rotations, and near ones translations.

    Source: random samples [Fischler 1981], then Gauss-Newton on the distances in the image with
    Huber's weights [Huber 1964]; docs/method.md section 18.
    """
    room = ~matches.people
    if room.sum() < config.room_min or len(room) < config.points_min:
        return None
    problem = _Problem(matches, mount, prior, config.gate_sigmas)
    solution = problem.solve(prior.before_from_now, room, FIRST_GATE)
    if (solution.off < config.gate_sigmas)[room].mean() < EASY_SHARE:
        solution = problem.solve(problem.best_sample(config.rounds), room, FIRST_GATE)
    if matches.people.any():
        solution = _with_people(problem, solution)
    pose, off = solution.pose, solution.off
    inliers = off < config.gate_sigmas
    if inliers[room].sum() < config.room_min or inliers.sum() < config.points_min:
        return None
    if np.sqrt(problem.prior_cost(pose[None])[0]) > config.prior_sigmas:
        return None
    # Errors larger than assumed increase the covariance; smaller ones are luck.
    spread = max(float(np.mean(off[inliers] ** 2)) / 2, 1.0) * config.sigma_factor**2
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
    """Return the solution by all points, if those on people move as the room does."""
    both = problem.solve(room.pose, np.ones(len(room.off), np.bool_), 1.0)
    error = problem.twists_to(room.pose[None], both.pose)[0]
    return both if error @ np.linalg.solve(room.inverse, error) < PEOPLE_SIGMAS**2 else room


class _Problem:
    """The cost of a motion: points, each by its own covariance, and the prior."""

    def __init__(self, matches: Matches, mount: BaseMount, prior: MotionPrior, gate: float) -> None:
        self._matches, self._free, self._prior, self._gate = matches, mount.free, prior, gate
        self._rays = Reprojector(matches, mount)
        self._information = np.linalg.inv(prior.covariance)
        self._all: Indices = np.arange(len(matches.then))[None]

    def solve(self, pose: F64, which: Flags, first_gate: float) -> _Solution:
        """Return the likeliest motion near one (4x4) by some points (N flags).

        From a guess all points count that may be inliers, in the end those that are: the gate of
        the first step is wider by `first_gate`.
        """
        rays = self._rays.project(pose[None], self._all)
        for step in range(STEPS):
            gate = self._gate * (first_gate if step == 0 else 1.0)
            off = np.sqrt(self._rays.cost(rays, self._all))
            weights = np.where((off < gate) & which, HUBER / np.maximum(off, HUBER), 0.0)
            twist, inverse = self._step(pose[None], self._all, weights, rays)
            pose = pose @ small_motions(twist)[0]
            rays = self._rays.project(pose[None], self._all)
            if np.abs(twist).max() < SMALL_STEP:
                break
        return _Solution(pose, inverse[0], np.sqrt(self._rays.cost(rays, self._all))[0])

    def depths(self, pose: F64, covariance: F64) -> tuple[F64, F64]:
        """Return errors of inverse depths (N) by a motion, and their standard deviations (N)."""
        rays = self._rays.project(pose[None], self._all)
        length = np.maximum(np.linalg.norm(rays.by_depth[0], axis=1), 1e-9)
        along = rays.by_depth[0] / length[:, None]
        by_twist = np.einsum("ni,nik->nk", along, self._rays.by_twist(rays, self._all)[0])
        by_motion = np.einsum("nk,kl,nl->n", by_twist, covariance, by_twist)
        errors = -np.einsum("ni,ni->n", along, rays.off[0]) / length
        return errors, np.sqrt(self._matches.noise**2 + by_motion) / length

    def common_error(self, pose: F64, inliers: Flags, inverse: F64) -> F64:
        """Return the covariance (KxK) of a motion by a common error of all depths."""
        rays = self._rays.project(pose[None], self._all)
        blind = (rays.by_depth[..., None, :] @ self._rays.by_twist(rays, self._all))[0, :, 0]
        length = (rays.by_depth[0] ** 2).sum(axis=-1)
        counts = inliers / self._matches.noise**2
        counts = counts * (1 - self._rays.along(rays, self._all)[0] * length)
        shift = inverse @ ((COMMON * self._matches.sigmas * counts) @ blind)
        return np.outer(shift, shift)

    def best_sample(self, rounds: int) -> F64:
        """Return the motion (4x4) by a few points that the most others agree on."""
        count = len(self._matches.then)
        room = np.flatnonzero(~self._matches.people)
        chosen = room[np.random.default_rng(0).integers(0, len(room), (rounds, SAMPLE))]
        poses = np.repeat(self._prior.before_from_now[None], rounds, axis=0)
        for _ in range(SAMPLE_STEPS):
            rays = self._rays.project(poses, chosen)
            twist, _ = self._step(poses, chosen, np.ones(chosen.shape), rays)
            poses = poses @ small_motions(twist)
        poses = np.concatenate([self._prior.before_from_now[None], poses])
        everything = np.broadcast_to(np.arange(count), (len(poses), count))
        cost = self._rays.cost(self._rays.project(poses, everything), everything)
        total = np.minimum(cost, self._gate**2).sum(axis=1) + self.prior_cost(poses)
        return np.asarray(poses[total.argmin()], np.float64)

    def _step(
        self, poses: F64, chosen: Indices, weights: F64, rays: Reprojection
    ) -> tuple[F64, F64]:
        """Return a Gauss-Newton step (Hx6) from H motions, and the inverse of its matrix (HxKxK).

        Points (indices HxM) have weights (HxM) and rays after the motions (Hx4x4).
        """
        weights = np.where(rays.front, weights, 0.0) / self._matches.noise[chosen] ** 2
        along = self._rays.along(rays, chosen)
        # S^-1 = (I - along j j') / sigma^2: errors that depth may explain do not count.
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
        """Return the twists (HxK) that lead from motions (Hx4x4) to another (4x4)."""
        rotations = np.einsum("hji,hjk->hik", poses[:, :3, :3], end[None, :3, :3])
        apart = end[:3, 3] - poses[:, :3, 3]
        shift = np.einsum("hji,hj->hi", poses[:, :3, :3], apart)
        turn = rotation_vectors(rotations)
        return np.asarray(np.concatenate([shift, turn], axis=1)[:, self._free])
