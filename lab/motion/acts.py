"""Acts of a standing person: bending, squatting, tying shoes, sitting, lying and falling.

An act passes through poses of the body, each given by the pitch of its segments in the room. The
feet stay on the floor where the person stands, and the lowest joint touches the support.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lab.bodies.rotations import about_x, about_y, about_z, turn
from lab.bodies.skeleton import INDEX, Skeleton
from lab.motion.bouts import WalkPath
from lab.motion.footfalls import Individual
from lab.motion.stance import ease
from lab.scenario import Act
from people4d.messages import F64

ACT_KEY = 7103  # key of the random numbers
VARIATION_DEG = 6.0  # standard deviation of the angles between acts
FALL_POWER = 2.2  # exponent of the progress of a fall in time: the body accelerates
BED_M = 0.5  # height of a bed
FLESH_M = 0.10  # distance of the joints of a lying torso from its support
RISE_S = 1.6  # duration of each movement back to standing
Posture = Literal["standing", "sitting", "lying", "bending"]


@dataclass(frozen=True)
class Pose:
    """Pitch of the segments in the room [deg], forward positive, left and right."""

    posture: Posture
    torso: tuple[float, float, float]  # pelvis, chest, head
    thighs: tuple[float, float]
    shanks: tuple[float, float]
    arms: tuple[float, float]  # upper arms, forearms
    roll: float = 0.0  # roll of the body about the forward axis, right positive [deg]
    support_m: float = 0.0  # height of the support of a lying body

    def values(self) -> F64:
        """Return all numbers in one array."""
        parts = (*self.torso, *self.thighs, *self.shanks, *self.arms, self.roll, self.support_m)
        return np.array(parts)


POSES = {
    "bend": Pose("bending", (45, 80, 60), (-6, -6), (10, 10), (-10, -20)),
    "squat": Pose("bending", (20, 35, 5), (-105, -105), (32, 32), (-35, -50)),
    "kneel": Pose("bending", (10, 30, 10), (-85, 5), (0, 85), (-20, -60)),
    "tie": Pose("bending", (20, 60, 50), (-100, 0), (15, 80), (-15, -40)),
    "all_fours": Pose("bending", (80, 88, 60), (-5, -5), (85, 85), (0, -5)),
    "sit": Pose("sitting", (-8, 4, 0), (-87, -87), (4, 4), (-14, -62)),
    "sit_tie": Pose("sitting", (25, 70, 50), (-85, -85), (8, 8), (-25, -35)),
    "sit_floor": Pose("sitting", (-15, 5, 0), (-90, -90), (-80, -80), (10, -10)),
    "supine": Pose("lying", (-88, -88, -82), (-88, -88), (-86, -86), (-84, -84)),
    "prone": Pose("lying", (88, 88, 85), (86, 86), (88, 88), (85, 85)),
    "right": Pose("lying", (5, 5, 5), (-35, -20), (25, 25), (-40, -70), roll=86),
    "left": Pose("lying", (5, 5, 5), (-20, -35), (25, 25), (-40, -70), roll=-86),
    "bed": Pose("lying", (-86, -84, -78), (-86, -86), (-84, -84), (-84, -84), support_m=BED_M),
}
STANDING = Pose("standing", (0, 0, 0), (0, 0), (0, 0), (0, 0))
ACTS: dict[str, tuple[str, ...]] = {
    "bend": ("bend",),
    "squat": ("squat",),
    "tie_shoes": ("kneel", "tie"),
    "sit": ("sit",),
    "sit_tie_shoes": ("sit", "sit_tie"),
    "lie": ("kneel", "all_fours", "prone"),
    "lie_back": ("squat", "sit_floor", "supine"),
    "lie_in_bed": ("sit", "bed"),
    "fall_forward": ("prone",),
    "fall_back": ("supine",),
    "fall_left": ("left",),
    "fall_right": ("right",),
    "collapse": ("squat", "right"),
}
FALLS = ("fall_forward", "fall_back", "fall_left", "fall_right", "collapse")
# Segments in the order of `Pose.values`; a foot follows its shank beyond 45 degrees
COLUMNS = ("pelvis", "chest", "head", "thigh_l", "thigh_r", "shank_l", "shank_r")


def is_fall(act: Act) -> bool:
    """Check whether an act is a fall."""
    return act.move in FALLS


def _stages(act: Act) -> list[tuple[float, float, Pose]]:
    """Return the movements of an act: begin, end and the pose that it reaches."""
    names, begin_s = ACTS[act.move], act.at_s
    stages = []
    for name in names:
        duration_s = act.move_s / len(names) if is_fall(act) else act.move_s
        stages.append((begin_s, begin_s + duration_s, POSES[name]))
        begin_s += duration_s
    begin_s += act.for_s
    if not act.stays:
        for name in (*names[-2::-1], ""):
            stages.append((begin_s, begin_s + RISE_S, POSES[name] if name else STANDING))
            begin_s += RISE_S
    return stages


def down_s(act: Act) -> float:
    """Return the time at which an act reaches its last pose [s]."""
    return _stages(act)[len(ACTS[act.move]) - 1][1]


def end_s(act: Act) -> float:
    """Return the time at which an act ends [s]."""
    return _stages(act)[-1][1]


def posture(acts: Sequence[Act], t_s: float) -> Posture | None:
    """Return the posture at a time; None while a movement changes it."""
    now: Posture = "standing"
    for act in acts:
        for begin_s, finish_s, pose in _stages(act):
            if begin_s < t_s < finish_s and pose.posture != now:
                return None
            if t_s >= finish_s:
                now = pose.posture
    return now


def perform(person: Individual, path: WalkPath, pelvis_m: F64, rotations: F64) -> None:
    """Move a standing body in place by the acts of a person.

    Args:
        person: Person with acts.
        path: Path, where the person stands during acts.
        pelvis_m: Tx3, frame: map.
        rotations: Tx13x3x3, map_from_segment.
    """
    values = _values(person, path.times_s)
    active = np.flatnonzero(np.abs(values).max(axis=1) > 1e-6)
    if not len(active):
        return
    values, yaw_rad, turned = values[active], path.yaw_rad[active], rotations[active]
    feet_m = _joints(person.skeleton, turned)[:, 2:4].mean(axis=1) + pelvis_m[active]
    ahead = about_z(yaw_rad) @ about_x(np.radians(values[:, 9]))
    for name, pitch_deg in _pitches(values):
        turned[:, INDEX[name]] = (
            ahead @ about_y(np.radians(pitch_deg)) @ about_z(-yaw_rad) @ turned[:, INDEX[name]]
        )
    rotations[active] = turned
    joints_m = _joints(person.skeleton, turned)
    ankle_m = float(-person.skeleton.heel[:, 2].min() + person.skeleton.ankle[:, 2].mean())
    radius_m = np.array([FLESH_M, FLESH_M, ankle_m, ankle_m, 0.06, 0.06, FLESH_M, FLESH_M])
    support_m = np.zeros((len(active), 8))
    support_m[:, [0, 1, 6, 7]] = values[:, 10:]
    offset_m = feet_m - joints_m[:, 2:4].mean(axis=1)
    offset_m[:, 2] = (support_m + radius_m - joints_m[..., 2]).max(axis=1)
    pelvis_m[active] = offset_m


def _values(person: Individual, times_s: F64) -> F64:
    """Return the numbers of the pose (see `Pose.values`) at T times, Tx11."""
    values = np.zeros((len(times_s), len(STANDING.values())))
    for number, act in enumerate(person.plan.acts):
        rng = np.random.default_rng([person.seed, ACT_KEY, person.index, number])
        for begin_s, finish_s, pose in _stages(act):
            goal = pose.values()
            if pose is not STANDING:
                goal[:-2] += rng.normal(0, VARIATION_DEG, len(goal) - 2)
            part = np.clip((times_s - begin_s) / (finish_s - begin_s), 0.0, 1.0)
            falls = is_fall(act) and begin_s < down_s(act)
            moved = part**FALL_POWER if falls else ease(part)
            values += (goal - values) * moved[:, None]
    return values


def _pitches(values: F64) -> list[tuple[str, F64]]:
    """Return the segments and their pitches; feet follow lying shanks."""
    found = [(name, values[:, column]) for column, name in enumerate(COLUMNS)]
    for side, end in enumerate("lr"):
        found += [(f"upper_arm_{end}", values[:, 7]), (f"forearm_{end}", values[:, 8])]
        shank_deg = values[:, 5 + side]
        found.append((f"foot_{end}", np.sign(shank_deg) * np.maximum(np.abs(shank_deg) - 45, 0)))
    return found


def _joints(skeleton: Skeleton, rotations: F64) -> F64:
    """Return hips, ankles, knees and shoulders relative to the pelvis, Tx8x3."""
    waist_m = turn(rotations[:, INDEX["pelvis"]], skeleton.waist)
    rows: dict[str, list[F64]] = {"hip": [], "ankle": [], "knee": [], "shoulder": []}
    for side, end in enumerate("lr"):
        hip_m = turn(rotations[:, INDEX["pelvis"]], skeleton.hip[side])
        thigh_m, shank_m = skeleton.knee[side] - skeleton.hip[side], skeleton.ankle[side]
        knee_m = hip_m + turn(rotations[:, INDEX[f"thigh_{end}"]], thigh_m)
        shank_m = shank_m - skeleton.knee[side]
        rows["hip"].append(hip_m)
        rows["knee"].append(knee_m)
        rows["ankle"].append(knee_m + turn(rotations[:, INDEX[f"shank_{end}"]], shank_m))
        shoulder_m = skeleton.shoulder[side] - skeleton.waist
        rows["shoulder"].append(waist_m + turn(rotations[:, INDEX["chest"]], shoulder_m))
    return np.stack([joint for pair in rows.values() for joint in pair], axis=1)
