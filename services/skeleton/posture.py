"""Posture of people: a hidden Markov model of the observed joints.

States are postures. The observation is a few angles and distances relative to the person's own
bones, in a frame with z up; joints without a reading widen its distribution. A broad state holds
observations that fit no posture (docs/method.md section 26).
"""

import numpy as np

from people4d.messages import F64
from people4d.messages.skeleton import POSTURES, Posture
from services.skeleton.observation import JointObservation
from services.skeleton.skeletons import People

SHOULDERS, HIPS, KNEES, ANKLES = [5, 6], [11, 12], [13, 14], [15, 16]
CONFIDENCE_MIN = 0.5  # minimum confidence of a keypoint
REACH_M = 1.3  # maximum distance of a joint from its track [m]
JOINT_M = 0.05  # minimum standard deviation of a joint [m]
MISSING_M2 = 100.0  # variance of a joint without a reading [m^2]
TORSO_M, LEG_M = (0.3, 0.8), (0.22, 0.65)  # range of the lengths of the torso and of leg bones [m]
SHOULDER_KNEE_M = (0.4, 1.3)  # range of the distance of shoulder and knee [m]
USUAL_LEG_M = 0.8  # length of a leg whose knee has no reading [m]
READ = 1.0  # maximum variance of the upward part of a bone with a reading
DWELL_S = 1.0  # mean duration of a posture [s]
CORRELATION_S = 0.2  # correlation time of the errors of joints [s]
WALKING_MPS = 0.8  # maximum speed in the model of postures [m/s]
LEARN_S = 1.0  # time constant of the height of a standing torso [s]
UPRIGHT = 0.9  # minimum probability of standing or walking to learn the height of the torso
PROBABILITY_MIN = 0.6  # minimum probability of a published posture
NONE: tuple[Posture, float] = ("unknown", 0.0)
OTHER = [POSTURES.index(name) for name in ("sitting", "lying", "bending")]
# Posture of each state; a person also sits bent, sits and rolls, squats and kneels
STATES = tuple(
    POSTURES.index(name)
    for name in (
        *("standing", "walking", "sitting", "sitting", "sitting", "lying"),
        *("bending", "bending", "bending", "unknown"),
    )
)
ROLLING, ROLLS = 4, 0.01  # state that rolls, its prior: about 1 % of people use wheelchairs
PRIOR: F64 = np.full(len(STATES), (1 - ROLLS) / (len(STATES) - 1))
PRIOR[ROLLING] = ROLLS
# Means of the observation in each state: see `observe_posture`, and the height of the torso below
# its height while standing [m]. Fitted with equal deviations to simulated people by
# `python -m benchmarks postures --fit --scenes 12 --falls 30`; the kneeling state, whose legs
# differ, has the means of both legs, the rolling state sits at the speed of walking. A separate
# fit to 7 daily scenes and 22 falls gave the column from knees to shoulders.
MEANS: F64 = np.array(
    [
        [0.98, 0.98, 0.97, 0.09, 0.99, 0.02, 0.00],
        [0.98, 0.95, 0.90, 0.23, 0.98, 0.69, 0.01],
        [0.97, 0.00, 0.95, 0.39, 0.80, 0.02, 0.38],
        [0.33, -0.03, 0.96, 0.38, 0.87, 0.02, 0.53],
        [0.97, 0.00, 0.95, 0.39, 0.80, 0.69, 0.38],
        [0.08, 0.04, 0.09, 0.92, 0.05, 0.02, 0.82],
        [0.27, 0.96, 0.93, 0.12, 0.82, 0.02, 0.19],
        [0.81, -0.23, 0.78, 0.14, 0.91, 0.02, 0.64],
        [0.57, 0.42, 0.57, 0.45, 0.87, 0.02, 0.49],
        [0.30, 0.30, 0.30, 0.40, 0.40, 0.30, 0.40],
    ]
)
# Standard deviations in all states but the last
SIGMAS: F64 = np.array(
    [[0.18, 0.21, 0.22, 0.19, 0.12, 0.18, 0.20]] * 9 + [[0.7, 0.7, 0.7, 0.5, 0.7, 1.0, 0.6]]
)


class PostureFilter:
    """Postures of all people."""

    def __init__(self) -> None:
        self._beliefs: dict[int, F64] = {}
        self._standing_m: dict[int, float] = {}  # height of each torso while standing

    def restart(self) -> None:
        """Restart all postures."""
        self._beliefs, self._standing_m = {}, {}

    def update(
        self, dt_s: float, people: People, observation: JointObservation
    ) -> tuple[list[tuple[Posture, float]], F64]:
        """Return the posture of each person and its probability; the probability of no other pose.

        Args:
            dt_s: Time since the last frame, at least 0.
            people: Tracks of the frame, N.
            observation: Observed joints of the frame.
        """
        if not people.ids:
            return [], np.ones(0)
        joints, joint_variances = observe_posture(people, observation)
        drop_m = [self._standing_m.get(n, np.nan) for n in people.ids] - people.position_m[:, 2]
        values = np.column_stack([joints, np.nan_to_num(drop_m)])
        variances = np.column_stack([joint_variances, np.where(np.isnan(drop_m), MISSING_M2, 0.0)])
        # Without legs and without a height a bent torso lies as well as it bends.
        variances[:, 0] += np.minimum(variances[:, 1], variances[:, -1])
        before = np.array([self._beliefs.get(person, PRIOR) for person in people.ids])
        stays = np.exp(-dt_s / DWELL_S)
        spread = variances[:, None] + SIGMAS**2
        fit = -0.5 * ((values[:, None] - MEANS) ** 2 / spread + np.log(spread)).sum(axis=2)
        fit = np.exp((fit - fit.max(axis=1, keepdims=True)) * min(dt_s / CORRELATION_S, 1.0))
        beliefs = (stays * before + (1 - stays) * PRIOR) * fit
        beliefs /= beliefs.sum(axis=1, keepdims=True)
        self._beliefs = dict(zip(people.ids, beliefs, strict=True))
        sums = np.zeros((len(beliefs), len(POSTURES)))
        np.add.at(sums.T, list(STATES), beliefs.T)
        self._learn(dt_s, people, sums[:, :2].sum(axis=1), joint_variances)
        best = sums.argmax(axis=1)
        known = [
            (POSTURES[k], float(row[k])) if row[k] >= PROBABILITY_MIN and k != STATES[-1] else NONE
            for row, k in zip(sums, best.tolist(), strict=True)
        ]
        return known, 1 - sums[:, OTHER].sum(axis=1)

    def _learn(self, dt_s: float, people: People, upright: F64, variances: F64) -> None:
        """Learn the heights of upright people whose legs are observed; forget other people."""
        share = 1 - np.exp(-dt_s / LEARN_S)
        learned = {n: self._standing_m[n] for n in people.ids if n in self._standing_m}
        for row in np.flatnonzero((upright > UPRIGHT) & (variances[:, 1] < READ)).tolist():
            number, now_m = people.ids[row], float(people.position_m[row, 2])
            before_m = learned.get(number, now_m)
            learned[number] = before_m + share * (now_m - before_m)
        self._standing_m = learned


def observe_posture(people: People, observation: JointObservation) -> tuple[F64, F64]:
    """Return the observations of N people and their variances, both Nx6.

    Columns: upward parts of torso, thighs and shanks, from -1 to 1; distance of hips and ankles on
    the ground in lengths of the leg; if the hips have no reading, upward part from knees to
    shoulders; speed on the ground, at most WALKING_MPS [m/s].
    """
    points_m = (
        observation.origin_m + np.nan_to_num(observation.range_m)[..., None] * observation.rays
    )
    away_m = np.linalg.norm(points_m - people.position_m[:, None], axis=2)
    is_read = np.isfinite(observation.range_m) & (observation.confidence > CONFIDENCE_MIN)
    variance_m2 = np.where(
        is_read & (away_m < REACH_M), JOINT_M**2 + observation.along_m**2 / 3, MISSING_M2
    )

    def bones(first: list[int], second: list[int], range_m: tuple[float, float]) -> F64:
        """Return vectors from the second to the first joints, with their variances, Nx2x4."""
        bone_m = points_m[:, first] - points_m[:, second]
        length_m = np.linalg.norm(bone_m, axis=2)
        fits = (length_m > range_m[0]) & (length_m < range_m[1])
        spread_m2 = np.where(fits, variance_m2[:, first] + variance_m2[:, second], 2 * MISSING_M2)
        return np.concatenate([bone_m, spread_m2[..., None]], axis=2)

    torso, thigh = bones(SHOULDERS, HIPS, TORSO_M), bones(HIPS, KNEES, LEG_M)
    shank = bones(KNEES, ANKLES, LEG_M)
    leg, upper = bones(HIPS, ANKLES, (0.0, np.inf)), bones(SHOULDERS, KNEES, SHOULDER_KNEE_M)
    is_read = (thigh + shank)[..., 3] < READ
    leg_m = np.linalg.norm(thigh[..., :3], axis=2) + np.linalg.norm(shank[..., :3], axis=2)
    leg_m = np.where(is_read, leg_m, USUAL_LEG_M)
    apart = np.linalg.norm(leg[..., :2], axis=2) / leg_m
    columns = [_upward(torso), _upward(thigh), _upward(shank)]
    columns.append(_mean(apart, leg[..., 3] / leg_m**2))
    # With hips it repeats the directions of torso and thighs.
    upward, variance = _upward(upper)
    columns.append((upward, np.where(columns[0][1] < READ, MISSING_M2, variance)))
    speed_mps = np.minimum(np.linalg.norm(people.velocity_mps[:, :2], axis=1), WALKING_MPS)
    # Speed alone is no sign of walking.
    is_read = np.minimum.reduce([columns[k][1] for k in (0, 1, 4)]) < READ
    columns.append((speed_mps, np.where(is_read, 0.0, MISSING_M2)))
    values, variances = zip(*columns, strict=True)
    return np.stack(values, axis=1), np.stack(variances, axis=1)


def _upward(bones: F64) -> tuple[F64, F64]:
    """Return the upward part of left and right bones with variances (Nx2x4)."""
    length_m = np.maximum(np.linalg.norm(bones[..., :3], axis=2), 1e-3)
    return _mean(bones[..., 2] / length_m, bones[..., 3] / length_m**2)


def _mean(value: F64, variance: F64) -> tuple[F64, F64]:
    """Return the weighted means of left and right (Nx2) and their variances."""
    weight = 1 / variance
    total = weight.sum(axis=1)
    return (weight * value).sum(axis=1) / total, 1 / total
