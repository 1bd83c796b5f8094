"""The motion of a base from directions in which points were seen, and are seen again."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import invert, rotation_from_rpy, transform_from
from people4d.messages import F64
from services.visual_odometry.config import FitConfig

BOOL = npt.NDArray[np.bool_]
INDICES = npt.NDArray[np.intp]

ALL = np.arange(6)  # a twist: vx, vy, vz, wx, wy, wz
PLANAR = np.array([0, 1, 5])  # of it what a base on a floor does
SAMPLE = 3  # points of a random sample
SAMPLE_STEPS, STEPS = 2, 6
SMALL_STEP = 1e-5  # [m, rad]
TOGETHER = 1.0  # of the doubt about depths that is the same for all: how large a room is
AS_ROOM = 3.0  # standard deviations that people may change what the room tells
FIRST_GATE = 4.0  # of the gate, at the first step
EASY_SHARE = 0.7  # of the points agree: no samples are needed
BEHIND = 1e-3  # of the axis: a point seen at right angles to it, or behind, is not seen
HUBER = 1.5  # standard deviations from which on a point counts less


@dataclass(frozen=True)
class Mount:
    """How a camera hangs on a base, and how that can move.

    Args:
        base_from_optical: 4x4.
        planar: Whether the base stays on a floor, the plane of its x and y axes.
    """

    base_from_optical: F64
    planar: bool

    @property
    def free(self) -> INDICES:
        """The entries of a twist that the base can have."""
        return PLANAR if self.planar else ALL

    def level(self, matrix: F64) -> F64:
        """Return the nearest motion that the base can make."""
        if not self.planar:
            return matrix
        turned = rotation_from_rpy(0.0, 0.0, float(np.arctan2(matrix[1, 0], matrix[0, 0])))
        return transform_from((*matrix[:2, 3], 0.0), turned)


@dataclass(frozen=True)
class Sights:
    """Points seen twice, by N rays each: x / z and y / z, frame: optical.

    Args:
        then: Nx2.
        now: Nx2.
        inverse_depths: N, 1 / z then, in 1/m.
        sigmas: N, standard deviations of these.
        noise: N, standard deviations of each coordinate of a ray.
        people: N, which may be on people: they count only if they do as the others.
    """

    then: F64
    now: F64
    inverse_depths: F64
    sigmas: F64
    noise: F64
    people: BOOL


@dataclass(frozen=True)
class Prior:
    """What is known of a motion before anything is seen.

    Args:
        before_from_now: 4x4, the likeliest.
        covariance: KxK, of the free entries of the twist by which it may be off.
    """

    before_from_now: F64
    covariance: F64


@dataclass(frozen=True)
class Fit:
    """A motion of the base.

    Args:
        before_from_now: 4x4, the base now in the frame of the base then.
        covariance: KxK, of the free entries of the twist by which the base may be elsewhere, frame:
            the base now.
        common: KxK, likewise, by what all depths are wrong together. It stays as long as the
            keyframe, so that it says nothing of the motion from frame to frame.
        inliers: N, points that agree.
        depth_errors: N, by how much each inverse depth seems to be more than thought, in 1/m.
        depth_sigmas: N, standard deviations of that.
    """

    before_from_now: F64
    covariance: F64
    common: F64
    inliers: BOOL
    depth_errors: F64
    depth_sigmas: F64


def fit_motion(sights: Sights, mount: Mount, prior: Prior, config: FitConfig) -> Fit | None:
    """Return the likeliest motion, as far as enough points agree on it.

    A point of unknown depth tells little along the line on which its depth would move it, and all
    across; so points too far for the sensor tell turns, and near ones the way.

    Args:
        sights: The points.
        mount: Of the camera.
        prior: What is known before.
        config: What is believed.

    Source: random samples (Fischler and Bolles, 1981), then Gauss-Newton on the distances in the
    image with Huber's weights.
    """
    room, everything = ~sights.people, np.ones(len(sights.then), np.bool_)
    if room.sum() < config.room_min or len(room) < config.points_min:
        return None
    scene = _Scene(sights, mount, prior, config.gate_sigmas)
    solved = scene.solved(prior.before_from_now, room, FIRST_GATE)
    if (solved.off < config.gate_sigmas)[room].mean() < EASY_SHARE:
        solved = scene.solved(scene.best_sample(config.rounds), room, FIRST_GATE)
    if sights.people.any():  # they count if they do as the room does
        both = scene.solved(solved.pose, everything, 1.0)
        away = scene.away(solved.pose, both.pose)
        if away @ np.linalg.solve(solved.inverse, away) < AS_ROOM**2:
            solved = both
    pose, off = solved.pose, solved.off
    inliers = off < config.gate_sigmas
    if inliers[room].sum() < config.room_min or inliers.sum() < config.points_min:
        return None
    if scene.unexpected(pose) > config.prior_sigmas:
        return None
    # Errors larger than thought make it less sure; smaller ones are luck.
    spread = max(float(np.mean(off[inliers] ** 2)) / 2, 1.0) * config.sigma_factor**2
    information = np.linalg.inv(prior.covariance)
    seen = np.linalg.inv(solved.inverse) - information
    covariance = np.linalg.inv(seen / spread + information)
    told = scene.depths(pose, covariance)
    return Fit(pose, covariance, scene.common(pose, inliers, solved.inverse), inliers, *told)


@dataclass(frozen=True)
class _Solved:
    """A motion (4x4), inverse of its normal matrix (KxK), standard deviations off of points (N)."""

    pose: F64
    inverse: F64
    off: F64


@dataclass(frozen=True)
class _Seen:
    """How rays are seen after H motions: their error, and how it changes with depth and motion."""

    off: F64  # HxNx2
    by_depth: F64  # HxNx2
    here: F64  # HxNx3, times the inverse depth, frame: the base now
    lens: F64  # HxNx2x3
    front: BOOL  # HxN, before the camera


class _Scene:
    """The cost of a motion: points, each by its own covariance, and what was known before."""

    def __init__(self, sights: Sights, mount: Mount, prior: Prior, gate: float) -> None:
        self._sights, self._mount, self._prior, self._gate = sights, mount, prior, gate
        self._information = np.linalg.inv(prior.covariance)
        base = mount.base_from_optical
        rays = np.column_stack([sights.then, np.ones(len(sights.then))])
        self._points = rays @ base[:3, :3].T + sights.inverse_depths[:, None] * base[:3, 3]
        self._optical_from_base = invert(base)

    def solved(self, pose: F64, which: BOOL, first_gate: float) -> _Solved:
        """Return the likeliest motion near one (4x4).

        Args:
            pose: Where to begin.
            which: N, points that count.
            first_gate: What the gate is multiplied by at first: from a guess all points count that
                may be meant, in the end those that agree.
        """
        everything = np.arange(len(self._sights.then))[None]
        seen = self._look(pose[None], everything)
        for step in range(STEPS):
            gate = self._gate * (first_gate if step == 0 else 1.0)
            off = np.sqrt(self._cost(seen, everything))
            weights = np.where((off < gate) & which, HUBER / np.maximum(off, HUBER), 0.0)
            twist, inverse = self._step(pose[None], everything, weights, seen)
            pose = pose @ _moves(twist)[0]
            seen = self._look(pose[None], everything)
            if np.abs(twist).max() < SMALL_STEP:
                break
        return _Solved(pose, inverse[0], np.sqrt(self._cost(seen, everything))[0])

    def depths(self, pose: F64, covariance: F64) -> tuple[F64, F64]:
        """Return by how much inverse depths (N) seem wrong after a motion, and how sure that is."""
        everything = np.arange(len(self._sights.then))[None]
        seen = self._look(pose[None], everything)
        length = np.maximum(np.linalg.norm(seen.by_depth[0], axis=1), 1e-9)
        along = seen.by_depth[0] / length[:, None]
        by_twist = np.einsum("ni,nik->nk", along, self._by_twist(seen, everything)[0])
        by_motion = np.einsum("nk,kl,nl->n", by_twist, covariance, by_twist)
        errors = -np.einsum("ni,ni->n", along, seen.off[0]) / length
        return errors, np.sqrt(self._sights.noise**2 + by_motion) / length

    def common(self, pose: F64, inliers: BOOL, inverse: F64) -> F64:
        """Return what a motion is off by (KxK) if all depths are wrong by a part of their doubt."""
        everything = np.arange(len(inliers))[None]
        seen = self._look(pose[None], everything)
        blind = (seen.by_depth[..., None, :] @ self._by_twist(seen, everything))[0, :, 0]
        length = (seen.by_depth[0] ** 2).sum(axis=-1)
        counts = inliers / self._sights.noise**2 * (1 - self._along(seen, everything)[0] * length)
        shift = inverse @ ((TOGETHER * self._sights.sigmas * counts) @ blind)
        return np.outer(shift, shift)

    def unexpected(self, pose: F64) -> float:
        """Return how many standard deviations a motion is off the one thought likeliest."""
        return float(np.sqrt(self._unexpected(pose[None])[0]))

    def best_sample(self, rounds: int) -> F64:
        """Return the motion (4x4) by a few points that the most others agree on."""
        count = len(self._sights.then)
        room = np.flatnonzero(~self._sights.people)
        chosen = room[np.random.default_rng(0).integers(0, len(room), (rounds, SAMPLE))]
        poses = np.repeat(self._prior.before_from_now[None], rounds, axis=0)
        for _ in range(SAMPLE_STEPS):
            seen = self._look(poses, chosen)
            twist, _ = self._step(poses, chosen, np.ones(chosen.shape), seen)
            poses = poses @ _moves(twist)
        poses = np.concatenate([self._prior.before_from_now[None], poses])
        everything = np.broadcast_to(np.arange(count), (len(poses), count))
        cost = self._cost(self._look(poses, everything), everything)
        total = np.minimum(cost, self._gate**2).sum(axis=1) + self._unexpected(poses)
        return np.asarray(poses[total.argmin()], np.float64)

    def _step(self, poses: F64, chosen: INDICES, weights: F64, seen: _Seen) -> tuple[F64, F64]:
        """Return a step of Gauss-Newton from each of H motions, and the inverse of its matrix.

        Args:
            poses: Hx4x4.
            chosen: HxM, indices of points.
            weights: HxM, of these.
            seen: How they are seen after these motions.

        Returns:
            Hx6 twists and HxKxK.
        """
        weights = np.where(seen.front, weights, 0.0) / self._sights.noise[chosen] ** 2
        along = self._along(seen, chosen)
        # S^-1 = (I - along j j') / sigma^2: what depth may explain does not count.
        jacobian = self._by_twist(seen, chosen)
        blind = (seen.by_depth[..., None, :] @ jacobian)[..., 0, :]
        off_blind = (seen.by_depth * seen.off).sum(axis=-1) * along
        flat = (*jacobian.shape[:1], -1, jacobian.shape[-1])
        weighted = (weights[..., None, None] * jacobian).reshape(flat).swapaxes(1, 2)
        blinded = (weights * along)[..., None] * blind
        normal = weighted @ jacobian.reshape(flat) - blinded.swapaxes(1, 2) @ blind
        side = (weighted @ seen.off.reshape(*flat[:2], 1))[..., 0]
        side -= ((weights * off_blind)[:, None] @ blind)[:, 0]
        inverse = np.linalg.inv(normal + self._information)
        pull = self._away(poses, self._prior.before_from_now) @ self._information
        twist = np.zeros((len(poses), 6))
        twist[:, self._mount.free] = (inverse @ (pull - side)[..., None])[..., 0]
        return twist, inverse

    def _look(self, poses: F64, chosen: INDICES) -> _Seen:
        """Return how points are seen after motions; a point p lies at p / inverse depth."""
        optical_from_base, sights = self._optical_from_base, self._sights
        turn, inverse = optical_from_base[:3, :3], sights.inverse_depths[chosen][..., None]
        here = (self._points[chosen] - inverse * poses[:, None, :3, 3]) @ poses[:, :3, :3]
        seen = here @ turn.T + inverse * optical_from_base[:3, 3]
        x, y, z = np.moveaxis(seen, -1, 0)
        front = z > BEHIND
        z = np.where(front, z, 1.0)
        off = np.stack([x / z, y / z], axis=-1) - sights.now[chosen]
        lens = np.zeros((*z.shape, 2, 3))
        lens[..., 0, 0] = lens[..., 1, 1] = 1 / z
        lens[..., 0, 2], lens[..., 1, 2] = -x / z**2, -y / z**2
        # As the depth grows less, a point moves by what the camera moved.
        moved = -np.einsum("hji,hj->hi", poses[:, :3, :3], poses[:, :3, 3])
        lever = self._mount.base_from_optical[:3, 3]
        moved = (moved + np.einsum("hji,j->hi", poses[:, :3, :3], lever)) @ turn.T
        moved = moved + optical_from_base[:3, 3]
        by_depth = np.einsum("hmij,hj->hmi", lens, moved)
        return _Seen(off, by_depth, here, lens, front)

    def _by_twist(self, seen: _Seen, chosen: INDICES) -> F64:
        """Return how errors change with the free entries of a twist of the base, HxNx2xK."""
        motions = np.zeros((*chosen.shape, 3, 6))
        motions[..., :3] = -self._sights.inverse_depths[chosen][..., None, None] * np.eye(3)
        motions[..., 3:] = _cross(seen.here)
        turned = self._optical_from_base[:3, :3] @ motions[..., self._mount.free]
        return np.asarray(seen.lens @ turned)

    def _along(self, seen: _Seen, chosen: INDICES) -> F64:
        """Return by how much a point counts less along the line that its depth moves it on."""
        variance = self._sights.sigmas[chosen] ** 2
        length = np.einsum("hmi,hmi->hm", seen.by_depth, seen.by_depth)
        return np.asarray(variance / (self._sights.noise[chosen] ** 2 + variance * length))

    def _cost(self, seen: _Seen, chosen: INDICES) -> F64:
        """Return the squared number of standard deviations (HxM) that points are off."""
        across = np.einsum("hmi,hmi->hm", seen.off, seen.off)
        along = np.einsum("hmi,hmi->hm", seen.by_depth, seen.off) ** 2
        cost = (across - self._along(seen, chosen) * along) / self._sights.noise[chosen] ** 2
        return np.where(seen.front, np.maximum(cost, 0.0), np.inf)

    def away(self, start: F64, end: F64) -> F64:
        """Return the twist (K) that leads from one motion (4x4) to another."""
        return np.asarray(self._away(start[None], end)[0])

    def _unexpected(self, poses: F64) -> F64:
        away = self._away(poses, self._prior.before_from_now)
        return np.asarray(np.einsum("hi,ij,hj->h", away, self._information, away))

    def _away(self, poses: F64, end: F64) -> F64:
        """Return the twists (HxK) that lead from motions (Hx4x4) to another (4x4)."""
        way = np.einsum("hji,hjk->hik", poses[:, :3, :3], end[None, :3, :3])
        apart = end[:3, 3] - poses[:, :3, 3]
        shift = np.einsum("hji,hj->hi", poses[:, :3, :3], apart)
        turn = _turns(way)
        return np.asarray(np.concatenate([shift, turn], axis=1)[:, self._mount.free])


def _moves(twists: F64) -> F64:
    """Return Hx4x4 of small twists (Hx6): by Rodrigues' formula."""
    angles = np.linalg.norm(twists[:, 3:], axis=1)[:, None, None]
    cross = _cross(twists[:, 3:])
    moves = np.repeat(np.eye(4)[None], len(twists), axis=0)
    moves[:, :3, :3] += np.sinc(angles / np.pi) * cross
    moves[:, :3, :3] += np.sinc(angles / 2 / np.pi) ** 2 / 2 * (cross @ cross)
    moves[:, :3, 3] = twists[:, :3]
    return moves


def _turns(rotations: F64) -> F64:
    """Return rotation vectors (Hx3) of Hx3x3, by less than a quarter turn."""
    r = rotations
    sines = (
        np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], 1) / 2
    )
    length = np.linalg.norm(sines, axis=1, keepdims=True).clip(1e-12, 1.0)
    return np.asarray(sines * np.arcsin(length) / length)


def _cross(points: F64) -> F64:
    """Return ...x3x3 matrices [p]x, so that p x w = [p]x w."""
    x, y, z = np.moveaxis(points, -1, 0)
    crossed = np.zeros((*x.shape, 3, 3))
    crossed[..., 0, 1], crossed[..., 0, 2], crossed[..., 1, 2] = -z, y, -x
    crossed[..., 1, 0], crossed[..., 2, 0], crossed[..., 2, 1] = z, -y, x
    return crossed
