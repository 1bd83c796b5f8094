"""Rules that derive events of postures and gestures from skeletons.

A fall ends lying and was fast: trunks of falling people exceed 1.3 m/s downward, trunks of people
sitting or lying down do not [Bourke 2008].
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from common.geometry.gestures import ELBOWS, SHOULDERS, WRISTS, hand_raised
from people4d.messages import F64, PersonSkeleton, Skeletons

TORSO = [5, 6, 11, 12]  # shoulders and hips
GAP_MAX_NS = 1_000_000_000  # maximum interval between two skeletons of a person [ns]
HISTORY_S = 1.4  # maximum time from a fall to lying [s]
WINDOW_S = 0.3  # interval of the downward speed [s]
FALL_MPS, FALL_SIGMA_MPS = 1.1, 0.12  # downward speed of a fall with probability 0.5; its spread
FALL_PROBABILITY = 0.5  # minimum probability of a fall
HOLD_S = 0.4  # minimum duration of a raised or pointing arm [s]
RAISED, LOWERED = 0.9, 0.5  # minimum probability of a raised hand, maximum of a lowered one
SWINGS, SWING_M = 3, 0.2  # reversals of a waving hand, and their minimum distance [m]
STRAIGHT = math.cos(math.radians(30))  # minimum cosine of the bend of a pointing arm's elbow
HANGING, STEEP = -0.75, 0.5  # range of the upward part of a pointing arm
STEADY = math.cos(math.radians(12))  # minimum cosine of the change of a pointing arm
FLOOR_MAX_M = 10.0  # maximum distance of a point on the floor [m]
UPRIGHT = ("standing", "walking")
POINTING = (*UPRIGHT, "sitting")  # postures in which arms have a meaning

Found = tuple[str, int, dict[str, Any]]  # kind, identity and further fields of an event


@dataclass
class _Person:
    """Recent motion of one person."""

    stamp_ns: int
    heights: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=128))
    posture: str = "unknown"  # last known
    since_s: float = 0.0  # begin of the posture
    is_down: bool = False  # True: fell and did not get up
    lies: bool = False  # True: the event of lying is published
    raised_s: float | None = None  # begin of a raised hand
    is_raised: bool = False
    wrists_m: deque[F64] = field(default_factory=lambda: deque(maxlen=20))
    is_waving: bool = False
    rays: deque[tuple[float, F64, F64]] = field(default_factory=lambda: deque(maxlen=64))
    is_pointing: bool = False


class PostureRules:
    """Derives events from skeletons.

    Args:
        lies_s: Duration of lying that is an event [s].
    """

    def __init__(self, lies_s: float) -> None:
        self._lies_s = lies_s
        self._people: dict[int, _Person] = {}

    def update(self, skeletons: Skeletons) -> list[Found]:
        """Return the events of a message; people with a gap in their stamps begin again."""
        stamp_ns, found = skeletons.stamp_ns, list[Found]()
        self._people = {
            number: person
            for number, person in self._people.items()
            if 0 <= stamp_ns - person.stamp_ns <= GAP_MAX_NS
        }
        for skeleton in skeletons.people:
            person = self._people.setdefault(skeleton.id, _Person(stamp_ns))
            person.stamp_ns = stamp_ns
            found += [
                (kind, skeleton.id, fields)
                for kind, fields in self._check(person, skeleton, stamp_ns / 1e9)
            ]
        return found

    def _check(
        self, person: _Person, skeleton: PersonSkeleton, now_s: float
    ) -> Iterator[tuple[str, dict[str, Any]]]:
        if skeleton.state == "lost":  # its posture and its height are predictions
            return
        person.heights.append((now_s, float(skeleton.positions_m[TORSO, 2].mean())))
        yield from self._check_posture(person, skeleton, now_s)
        if skeleton.posture not in POINTING:
            person.raised_s = None
            person.rays.clear()
            return
        yield from _check_hand(person, skeleton, now_s)
        yield from _check_pointing(person, skeleton, now_s)

    def _check_posture(
        self, person: _Person, skeleton: PersonSkeleton, now_s: float
    ) -> Iterator[tuple[str, dict[str, Any]]]:
        before, now = person.posture, skeleton.posture
        probability = skeleton.posture_probability
        if now not in ("unknown", before):
            person.posture, person.since_s = now, now_s
            if now == "lying":
                person.lies = False
                speed_mps = _speed_down_mps(person, now_s)
                fell = probability / (1 + math.exp((FALL_MPS - speed_mps) / FALL_SIGMA_MPS))
                if fell >= FALL_PROBABILITY:
                    person.is_down = True
                    person.heights.clear()  # one downward motion is one fall
                    reason = f"down at {speed_mps:.1f} m/s, then lying"
                    yield "fell", {"confidence": fell, "reason": reason}
            elif now == "sitting" and before in (*UPRIGHT, "bending"):
                yield "sat_down", {"confidence": probability}
            elif now in UPRIGHT:
                if person.is_down:
                    yield "got_up", {"confidence": probability}
                elif before in ("sitting", "lying"):
                    yield "stood_up", {"confidence": probability}
                person.is_down = False
        lies_s = now_s - person.since_s
        if person.posture == now == "lying" and not person.lies and lies_s >= self._lies_s:
            person.lies = True
            yield "lies", {"confidence": probability, "dwell_s": lies_s}


def _speed_down_mps(person: _Person, now_s: float) -> float:
    """Return the largest downward speed of the torso in the last seconds."""
    samples = [one for one in person.heights if now_s - one[0] <= HISTORY_S]
    fastest, first = 0.0, 0
    for time_s, height_m in samples:
        while first + 1 < len(samples) and samples[first + 1][0] <= time_s - WINDOW_S + 1e-6:
            first += 1
        begin_s, begin_m = samples[first]
        if time_s - begin_s >= WINDOW_S - 1e-6:
            fastest = max(fastest, (begin_m - height_m) / (time_s - begin_s))
    return fastest


def _check_hand(
    person: _Person, skeleton: PersonSkeleton, now_s: float
) -> Iterator[tuple[str, dict[str, Any]]]:
    raised = hand_raised(skeleton.positions_m, skeleton.covariances_m2, skeleton.measured)
    if raised < LOWERED:
        person.raised_s, person.is_raised, person.is_waving = None, False, False
        person.wrists_m.clear()
    elif raised >= RAISED and person.raised_s is None:
        person.raised_s = now_s
    if person.raised_s is None:
        return
    upper = max(WRISTS, key=lambda joint: float(skeleton.positions_m[joint, 2]))
    person.wrists_m.append(
        (skeleton.positions_m[upper] - skeleton.positions_m[upper - 4])[:2].astype(np.float64)
    )
    if not person.is_raised and now_s - person.raised_s >= HOLD_S:
        person.is_raised = True
        yield "raised_hand", {"confidence": raised}
    if person.is_raised and not person.is_waving and _reversals(person.wrists_m) >= SWINGS:
        person.is_waving = True
        yield "waved", {"confidence": raised}


def _reversals(wrists_m: deque[F64]) -> int:
    """Return the number of reversals of a hand along its main direction on the ground."""
    points_m = np.array(wrists_m) - np.mean(wrists_m, axis=0)
    along_m = points_m @ np.linalg.svd(points_m, full_matrices=False)[2][0]
    reversals, extreme_m, direction = 0, float(along_m[0]), 0.0
    for value_m in along_m.tolist():
        if direction == 0.0 or (value_m - extreme_m) * direction < -SWING_M:
            if abs(value_m - extreme_m) > SWING_M:
                reversals += direction != 0.0
                direction, extreme_m = math.copysign(1.0, value_m - extreme_m), value_m
        elif (value_m - extreme_m) * direction > 0:
            extreme_m = value_m
    return reversals


def _check_pointing(
    person: _Person, skeleton: PersonSkeleton, now_s: float
) -> Iterator[tuple[str, dict[str, Any]]]:
    ray = _pointing_ray(skeleton)
    if ray is None or (person.rays and person.rays[-1][2] @ ray[1] < STEADY):
        person.rays.clear()
        person.is_pointing = person.is_pointing and ray is not None
    if ray is None:
        return
    person.rays.append((now_s, *ray))
    if person.is_pointing or now_s - person.rays[0][0] < HOLD_S:
        return
    person.is_pointing = True
    origin_m = np.mean([one[1] for one in person.rays], axis=0)
    direction = np.mean([one[2] for one in person.rays], axis=0)
    direction /= np.linalg.norm(direction)
    fields: dict[str, Any] = {"direction": direction}
    if direction[2] < 0 < -origin_m[2] / direction[2] <= FLOOR_MAX_M:
        fields["target_m"] = origin_m - origin_m[2] / direction[2] * direction
    yield "pointed", fields


def _pointing_ray(skeleton: PersonSkeleton) -> tuple[F64, F64] | None:
    """Return shoulder and direction of a straight arm with a visible wrist that does not hang."""
    for joints in zip(SHOULDERS, ELBOWS, WRISTS, strict=True):
        if not skeleton.measured[joints[2]]:
            continue
        shoulder_m, elbow_m, wrist_m = skeleton.positions_m[list(joints)].astype(np.float64)
        direction = _unit(wrist_m - shoulder_m)
        if not HANGING < direction[2] < STEEP:
            continue
        if _unit(elbow_m - shoulder_m) @ _unit(wrist_m - elbow_m) > STRAIGHT:
            return shoulder_m, direction
    return None


def _unit(vector: F64) -> F64:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-6))
