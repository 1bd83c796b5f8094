"""Skeletons of tracked people: visible joints are measured, hidden joints predicted.

A joint is visible if the surface at its keypoint is at the expected depth. A nearer surface hides
it; its keypoint then gives a direction only. Bones, with lengths learned for each person, and the
usual pose constrain the other joints (docs/method.md section 26).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from people4d.messages import F64, Track
from services.skeleton.body import (
    BONE_LENGTHS_M,
    BONE_SIGMA,
    BONES,
    JOINT_COUNT,
    LEVELS,
    LIMBS,
    MIRRORED,
    TORSO,
    USUAL_POSE_M,
    USUAL_SIGMA_M,
    unturned_pose,
    yaw_rotations,
)
from services.skeleton.joint_filter import (
    LASTS_S,
    UNKNOWN_M2,
    JointStates,
    predict_joints,
    update_bones,
    update_points,
)
from services.skeleton.observation import JointObservation

Flags = npt.NDArray[np.bool_]
ALL_BONES = tuple(bones for level in BONES for bones in level)
FIRST, SECOND, KIND = (
    [number for bones in ALL_BONES for number in getattr(bones, part)]
    for part in ("first", "second", "kind")
)
THIGHS = [bone for bone, kind in enumerate(KIND) if kind == 5]  # bones from hips to knees
BENT_KIND = [11 if kind == 2 else kind for kind in KIND]  # kinds if the torso is not upright
SHAPES_MAX = 1000  # maximum number of stored body shapes
AWAY_MAX_M = 0.6  # maximum distance of a torso from its track; beyond, the skeleton restarts [m]
CONFIDENT = 0.5  # minimum confidence of a keypoint with constant noise
ACROSS_M = 0.028  # standard deviation of a visible joint across the line of sight [m]
HIDDEN_ACROSS_M = 0.08  # standard deviation of a hidden joint across the line of sight [m]
SURFACES_M = 0.3  # width of the uniform density of other surfaces [m]
OUTLIER_SIGMAS = 3.0  # maximum distance of a keypoint with full weight [standard deviations]
POSE_S = 0.2  # interval of independent observations of the usual pose [s]
UNUSUAL_M = 0.6  # standard deviation of the usual pose without standing, or with a reading [m]
SIZE_SIGMA = 0.15  # relative standard deviation of the size of people of all ages
# Change of the lengths with the size [m]; noise hides it in the short bones
_SIZE_M = SIZE_SIGMA * BONE_LENGTHS_M * [0, 0, 1, 1, 1, 1, 1, 0, 0, 0, 0, 1]
BONES_M2: F64 = np.diag((BONE_SIGMA * BONE_LENGTHS_M) ** 2) + np.outer(_SIZE_M, _SIZE_M)
BONE_M = 0.03  # standard deviation of the length of a bone between frames [m]
BONE_FRAMES = 10.0  # number of correlated measurements of a bone
LEARN_S = 10.0  # time constant of a person's usual pose [s]
SIDES_GAIN = 8.0  # minimum decrease of squared distances for an exchange of sides
STATURE_BONES = [2, 5, 6]  # torso, thigh and shank: rows of BONE_LENGTHS_M
STATURE = 1.37  # stature in lengths of these bones, median of 12 simulated people
STATURE_SIGMA = 0.04  # relative standard deviation of the ratio, between people and detectors
MISFIT_MAX = 25.0  # maximum squared distance of a joint [variances]


@dataclass
class BodyShape:
    """Learned shape of a body."""

    bones_m: F64  # lengths, by kind
    bones_m2: F64  # covariance of the lengths
    pose_m: F64  # 17x3, usual pose


@dataclass(frozen=True)
class People:
    """N tracked people of one frame."""

    ids: Sequence[int]
    position_m: F64  # Nx3
    velocity_mps: F64  # Nx3
    covariance_m2: F64  # Nx3x3, covariance of the position
    yaw_rad: F64  # N, NaN: unknown

    @classmethod
    def from_tracks(cls, tracks: Sequence[Track]) -> "People":
        """Return the people of tracks."""
        return cls(
            ids=[track.id for track in tracks],
            position_m=np.array([track.position_m for track in tracks]).reshape(-1, 3),
            velocity_mps=np.array([track.velocity_mps for track in tracks]).reshape(-1, 3),
            covariance_m2=np.array([t.covariance[:3, :3] for t in tracks]).reshape(-1, 3, 3),
            yaw_rad=np.array([np.nan if t.yaw_rad is None else t.yaw_rad for t in tracks], float),
        )


class SkeletonTracker:
    """Skeletons of all people in one fixed frame."""

    def __init__(self) -> None:
        self._ids: list[int] = []
        self._states = JointStates(np.zeros((0, JOINT_COUNT, 6)), np.zeros((0, JOINT_COUNT, 6, 6)))
        self._shapes: dict[int, BodyShape] = {}

    def restart_skeletons(self) -> None:
        """Restart all skeletons; learned shapes remain."""
        self._ids = []

    def estimate_joints(
        self, dt_s: float, people: People, observation: JointObservation, upright: F64
    ) -> tuple[JointStates, Flags]:
        """Return the joints of all people in a frame, and flags (Nx17) of measured joints.

        Args:
            dt_s: Time since the last frame.
            people: Tracks of the frame.
            observation: Observed joints of the frame.
            upright: N, probability that the usual pose applies.
        """
        shapes = [self._shape(person) for person in people.ids]
        pose_m, pose_m2 = self._poses(people, shapes)
        states = self._predicted(dt_s, people, pose_m, pose_m2)
        is_read = (observation.confidence > CONFIDENT) & np.isfinite(observation.range_m)
        # A hidden elbow or knee follows from its ends.
        is_read[:, LEVELS[1]] |= is_read[:, LEVELS[2]]
        unusual = np.maximum(1 - upright[:, None], is_read)
        pose_m2 = pose_m2 + unusual[..., None, None] * UNUSUAL_M**2 * np.eye(3)
        scale = max(dt_s, 1e-3) / POSE_S
        update_points(states, list(range(JOINT_COUNT)), pose_m, pose_m2 / min(scale, 1.0))
        self._order_sides(states, observation)
        bones_m = np.array([shape.bones_m for shape in shapes]).reshape(-1, len(BONE_LENGTHS_M))
        bones_m2 = [shape.bones_m2.diagonal() for shape in shapes]
        sigma_m = np.sqrt(np.array(bones_m2).reshape(bones_m.shape) + BONE_M**2)
        measured = np.zeros((len(people.ids), JOINT_COUNT), np.bool_)
        for level, joints in enumerate(LEVELS):
            if level:
                for bones in BONES[level]:
                    update_bones(states, bones, bones_m, sigma_m)
            measured[:, joints] = self._measure(states, joints, observation)
        for bones in ALL_BONES:
            update_bones(states, bones, bones_m, sigma_m)
        self._learn(dt_s, people, shapes, states, measured, observation, upright > 0.5)
        self._ids, self._states = list(people.ids), states
        return states, measured

    def estimate_statures(self, people: People) -> tuple[F64, F64]:
        """Return the statures of people and their standard deviations, both N [m]."""
        shapes = [self._shape(person) for person in people.ids]
        block = np.ix_(STATURE_BONES, STATURE_BONES)
        stature_m = STATURE * np.array([one.bones_m[STATURE_BONES].sum() for one in shapes])
        spread_m = STATURE * np.sqrt([one.bones_m2[block].sum() for one in shapes])
        return stature_m, np.hypot(spread_m, STATURE_SIGMA * stature_m)

    def _shape(self, person: int) -> BodyShape:
        shape = self._shapes.pop(person, None)
        if shape is None:
            shape = BodyShape(BONE_LENGTHS_M.copy(), BONES_M2.copy(), USUAL_POSE_M.copy())
            if len(self._shapes) >= SHAPES_MAX:
                del self._shapes[next(iter(self._shapes))]
        self._shapes[person] = shape
        return shape

    def _poses(self, people: People, shapes: Sequence[BodyShape]) -> tuple[F64, F64]:
        """Return the usual poses in the fixed frame: means Nx17x3, covariances Nx17x3x3."""
        pose_m = np.array([shape.pose_m for shape in shapes]).reshape(-1, JOINT_COUNT, 3)
        sigma_m = np.broadcast_to(USUAL_SIGMA_M, pose_m.shape)
        unknown = np.isnan(people.yaw_rad)
        wide_m, wide_sigma_m = unturned_pose(pose_m, sigma_m)
        pose_m = np.where(unknown[:, None, None], wide_m, pose_m)
        sigma_m = np.where(unknown[:, None, None], wide_sigma_m, sigma_m)
        rotation = yaw_rotations(np.nan_to_num(people.yaw_rad))[:, None]
        spread = rotation * (sigma_m**2)[:, :, None, :] @ np.swapaxes(rotation, -1, -2)
        mean_m = people.position_m[:, None] + (rotation @ pose_m[..., None])[..., 0]
        return mean_m, spread + people.covariance_m2[:, None]

    def _predicted(self, dt_s: float, people: People, pose_m: F64, pose_m2: F64) -> JointStates:
        """Return the predicted states of known people, and the usual pose of new people."""
        count = len(people.ids)
        fresh = JointStates(np.zeros((count, JOINT_COUNT, 6)), np.zeros((count, JOINT_COUNT, 6, 6)))
        fresh.mean[..., :3], fresh.mean[..., 3:] = pose_m, people.velocity_mps[:, None]
        fresh.covariance[..., :3, :3] = pose_m2
        fresh.covariance[..., 3:, 3:] = np.eye(3) * LASTS_S
        rows = {person: row for row, person in enumerate(self._ids)}
        pairs = [(n, rows[p]) for n, p in enumerate(people.ids) if p in rows]
        if not pairs:
            return fresh
        now, before = np.array(pairs).T
        known = JointStates(self._states.mean[before], self._states.covariance[before])
        velocity = people.velocity_mps[now]
        predict_joints(known, dt_s, velocity)
        away_m = known.position_m[:, TORSO].mean(axis=1) - people.position_m[now]
        near = np.linalg.norm(away_m, axis=1) <= AWAY_MAX_M
        fresh.mean[now[near]] = known.mean[near]
        fresh.covariance[now[near]] = known.covariance[near]
        return fresh

    def _order_sides(self, states: JointStates, observation: JointObservation) -> None:
        """Exchange left and right arms or legs of an observation if this fits better."""
        to_m = states.position_m - observation.origin_m
        along_m = np.einsum("nji,nji->nj", to_m, observation.rays)
        straight = self._misfit(to_m, observation.rays, observation.confidence, states)
        mirrored = self._misfit(
            to_m, observation.rays[:, MIRRORED], observation.confidence[:, MIRRORED], states
        )
        for limb in LIMBS:
            others = [MIRRORED[joint] for joint in limb]
            better = mirrored[:, limb].sum(axis=1) + SIDES_GAIN < straight[:, limb].sum(axis=1)
            for person in np.flatnonzero(better & (along_m[:, limb] > 0).all(axis=1)).tolist():
                observation.exchange_joints(person, limb, others)

    def _misfit(self, to_m: F64, rays: F64, confidence: F64, states: JointStates) -> F64:
        """Return squared distances of expected joints from rays, in variances, Nx17."""
        along = np.einsum("nji,nji->nj", to_m, rays)
        across = to_m - along[..., None] * rays
        spread = np.einsum("njii->nj", states.position_m2) / 3
        found = (across**2).sum(axis=-1) / (spread + HIDDEN_ACROSS_M**2)
        return np.where(confidence > 0, np.minimum(found, MISFIT_MAX), 0.0)

    def _measure(
        self, states: JointStates, joints: list[int], observation: JointObservation
    ) -> Flags:
        """Measure the joints of one level; return flags of visible joints, NxJ."""
        rays, read_m = observation.rays[:, joints], observation.range_m[:, joints]
        confidence = observation.confidence[:, joints]
        to_m = states.mean[:, joints, :3] - observation.origin_m
        expected_m = np.maximum(np.einsum("nji,nji->nj", to_m, rays), 0.1)
        position_m2 = states.covariance[:, joints, :3, :3]
        along_m2 = np.einsum("nji,njik,njk->nj", rays, position_m2, rays)
        visible = self._visible(
            read_m - expected_m, along_m2 + observation.along_m[:, joints] ** 2, confidence
        )
        uncertainty = np.maximum(CONFIDENT / np.maximum(confidence, 0.01), 1.0)
        across_m = np.hypot(ACROSS_M, observation.across_per_m * expected_m) * uncertainty
        across_m = np.where(visible, across_m, np.hypot(across_m, HIDDEN_ACROSS_M))
        range_m = np.where(visible, read_m, expected_m)
        points_m = observation.origin_m + range_m[..., None] * rays
        # Outliers across the line of sight have a lower weight.
        off_m = points_m - states.mean[:, joints, :3]
        off_m -= np.einsum("nji,nji->nj", off_m, rays)[..., None] * rays
        spread_m2 = (np.einsum("njii->nj", position_m2) - along_m2) / 2 + across_m**2
        sigmas2 = (off_m**2).sum(axis=-1) / spread_m2 / OUTLIER_SIGMAS**2
        across_m2 = across_m**2 + spread_m2 * np.maximum(sigmas2 - 1, 0)
        across_m2 = np.where(confidence > 0, across_m2, UNKNOWN_M2)
        range_m2 = np.where(visible, observation.along_m[:, joints] ** 2, UNKNOWN_M2)
        outer = rays[..., None] * rays[..., None, :]
        covariances = across_m2[..., None, None] * (np.eye(3) - outer)
        covariances += range_m2[..., None, None] * outer
        update_points(states, joints, points_m, covariances)
        return visible

    def _visible(self, off_m: F64, variance_m2: F64, confidence: F64) -> Flags:
        """Flag readings more likely of the joint than of another surface (offsets NxJ)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            own = np.exp(-(off_m**2) / variance_m2 / 2) / np.sqrt(2 * np.pi * variance_m2)
            odds = confidence / (1 - np.minimum(confidence, 0.99))
            found = own * odds * SURFACES_M > 1.0
        return np.asarray(found & (confidence > 0) & np.isfinite(off_m))

    def _learn(
        self,
        dt_s: float,
        people: People,
        shapes: Sequence[BodyShape],
        states: JointStates,
        measured: Flags,
        observation: JointObservation,
        is_upright: Flags,
    ) -> None:
        """Learn bones and usual poses from measured joints."""
        share = 1 - float(np.exp(-dt_s / LEARN_S))
        rotation = yaw_rotations(np.nan_to_num(people.yaw_rad))
        pose_m = (states.position_m - people.position_m[:, None]) @ rotation
        for row, shape in enumerate(shapes):
            if np.isfinite(people.yaw_rad[row]):
                learned = measured[row]
                shape.pose_m[learned] += share * (pose_m[row, learned] - shape.pose_m[learned])
        with np.errstate(invalid="ignore"):
            points_m = observation.origin_m + observation.range_m[..., None] * observation.rays
        apart_m2 = ((points_m[:, FIRST] - points_m[:, SECOND]) ** 2).sum(axis=-1)
        # Noise makes bones longer: E |d + n|^2 = |d|^2 + E |n|^2.
        across_m2 = ACROSS_M**2 + (observation.across_per_m * observation.range_m) ** 2
        joint_m2 = 2 * across_m2 + observation.along_m**2
        noise_m2 = joint_m2[:, FIRST] + joint_m2[:, SECOND]
        both = measured[:, FIRST] & measured[:, SECOND]
        both[:, THIGHS] &= is_upright[:, None]  # seated, belly and lap hide hips
        lengths_m = np.sqrt(np.fmax(apart_m2 - noise_m2, 1e-6))
        weights = np.where(both, 3 / BONE_FRAMES / noise_m2, 0.0)
        for row, shape in enumerate(shapes):
            kind = KIND if is_upright[row] else BENT_KIND
            weight = np.bincount(kind, weights[row], len(shape.bones_m))
            total = np.bincount(kind, weights[row] * lengths_m[row], len(weight))
            # Lengths of one kind inform the others: P = (P^-1 + W)^-1.
            shape.bones_m2[:] = np.linalg.solve(
                np.eye(len(weight)) + shape.bones_m2 * weight, shape.bones_m2
            )
            shape.bones_m += shape.bones_m2 @ (total - weight * shape.bones_m)
