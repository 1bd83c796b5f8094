"""Comparison of points and steps of tracked people with joints.

The recording needs known joints.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from benchmarks.lib.gait.event_peers import PeerLandings, peer_landings
from benchmarks.lib.gait.tally import Tally
from benchmarks.lib.gait.truth import (
    JOINT,
    even_truth,
    references,
    steady_cadence,
    steps_by_ankles,
    true_asymmetry,
)
from evaluation.gait.parameters import gait_parameters, limping_side
from evaluation.gait.tables import GaitTables
from lab.truth.motion_capture import Footfall
from people4d.messages import F64, GaitMeasures, PersonGait
from services.gait.estimator import GaitResult
from services.gait.steps.steps import FEET, FootStep, Side

Flags = npt.NDArray[np.bool_]

LIMBS = ("left_hand", "right_hand", "left_foot", "right_foot")
COUNTERPART = {0: 1, 1: 0, 2: 3, 3: 2}
ANKLES = (15, 16)
SAME_PERSON_M = 0.6  # Maximum level distance of a head to the true one [m]
EXCHANGED_M = 0.10  # Minimum excess of the error of a point with the name of its counterpart [m]
HIDDEN_OFF_M = 0.10  # Minimum error of a false measurement of a hidden point [m]
COVERED_90 = 6.251  # chi-square of 3 degrees of freedom

NEAR_S = 0.3  # Maximum time between a detected step and the true one [s]
LIMP = 0.08  # Minimum true asymmetry of step times of a limp
WALKED_STEPS = 3  # Minimum number of steps in view of a person with measures


@dataclass(frozen=True)
class JointTruth:
    """Joints of K people in N frames, frame: map."""

    times_s: F64  # N
    joints_m: F64  # NxKx17x3, COCO order
    visible: Flags  # NxKx17
    camera_m: F64  # Nx3, position of the camera
    in_view: Flags  # NxK, True if the feet are in the image
    in_range: Flags  # NxKx17, True if nearer than the maximum depth
    # Footfalls of each person, if known; small footfalls count neither as steps nor as invented
    footfalls: list[list[Footfall]] | None = None


def tally(
    truth: JointTruth,
    results: Sequence[Sequence[GaitResult]],
    stamps_ns: Sequence[int],
    python: str = "",
) -> list[Tally]:
    """Return the comparisons of each true person.

    Args:
        truth: Truth of N frames.
        results: Results of each frame.
        stamps_ns: N.
        python: Interpreter with event detectors of other packages; empty: none.
    """
    people = truth.joints_m.shape[1]
    reference = references(truth.joints_m, truth.camera_m)
    assigned: list[dict[int, PersonGait]] = []
    votes: dict[int, list[int]] = {}
    tables = GaitTables()
    for index, frame in enumerate(results):
        tables.add_frame(stamps_ns[index], frame)
        before = {one.id: k for k, one in assigned[-1].items()} if assigned else {}
        people_here = [one.person for one in frame]
        assigned.append(_assigned(people_here, truth.joints_m[index], before))
        for k, person in assigned[-1].items():
            votes.setdefault(person.id, [0] * people)[k] += 1
    walks = {str(key): tables.trajectories(key) for key in tables.people}
    peers = peer_landings(python, walks) if python else {}
    tallies = [Tally() for _ in range(people)]
    for k in range(people):
        for index, found in enumerate(assigned):
            if k in found:
                flags = truth.visible[index, k], truth.in_range[index, k]
                _points(tallies[k], found[k], reference[index, k], *flags)
        own = [key for key, counts in votes.items() if int(np.argmax(counts)) == k]
        falls = steps_by_ankles(truth.times_s, truth.joints_m[:, k, ANKLES])
        begun = steps_by_ankles(truth.times_s, truth.joints_m[:, k, ANKLES], begun=True)
        begun += [] if truth.footfalls is None else truth.footfalls[k]
        _steps(tallies[k], truth, k, (falls, begun), tables, own, peers)
        _live(tallies[k], truth, falls, [found.get(k) for found in assigned])
    return tallies


def _assigned(
    estimates: Sequence[PersonGait], joints_m: F64, before: Mapping[int, int]
) -> dict[int, PersonGait]:
    """Return the estimates by the number of their true person, one to one, matched by heads.

    A pair of the frame before lasts while it is near, so a hidden and predicted person takes no
    estimate of another one [Bernardin 2008].
    """
    off_m = np.array([_off_m(one, joints_m) for one in estimates]).reshape(-1, len(joints_m))
    costs = np.minimum(off_m, SAME_PERSON_M)
    for row, one in enumerate(estimates):
        k = before.get(one.id)
        if k is not None and off_m[row, k] < SAME_PERSON_M:
            costs[row, k] -= len(estimates) * SAME_PERSON_M
    rows, columns = linear_sum_assignment(costs)
    return {
        int(k): estimates[int(row)]
        for row, k in zip(rows, columns, strict=True)
        if off_m[row, k] < SAME_PERSON_M
    }


def _off_m(person: PersonGait, joints_m: F64) -> F64:
    """Return the level distances of an estimate to K true heads, by its head or all points."""
    points = [p.position_m for p in person.points if p.name == "head"] or [
        p.position_m for p in person.points
    ]
    if not points:
        return np.full(len(joints_m), np.inf)
    heads_m = joints_m[:, :5, :2].mean(axis=1)
    return np.asarray(np.linalg.norm(heads_m - np.mean(points, axis=0)[:2], axis=1))


def _points(
    tally_: Tally, person: PersonGait, reference: F64, visible: Flags, in_range: Flags
) -> None:
    by_name = {point.name: point for point in person.points}
    for k, name in enumerate(LIMBS):
        unhidden = bool(visible[JOINT[k]])
        point = by_name.get(name)
        tally_.visible += unhidden
        tally_.hidden_all += not unhidden
        near = unhidden and bool(in_range[JOINT[k]])
        tally_.visible_in_range += near
        if point is None or point.state == "lost":
            continue
        offset = point.position_m - reference[k]
        error_m = float(np.linalg.norm(offset))
        other_m = float(np.linalg.norm(point.position_m - reference[COUNTERPART[k]]))
        when = "visible" if unhidden else "hidden"
        measured = point.state == "measured"
        kind = name.split("_")[1]
        tally_.errors_m.setdefault(f"{kind} {when}", []).append(error_m)
        if near:
            tally_.errors_m.setdefault(f"{kind} in range", []).append(error_m)
        if unhidden and measured:
            tally_.errors_m.setdefault(f"{kind} measured", []).append(error_m)
        tally_.exchanged.setdefault(when, []).append(other_m < error_m - EXCHANGED_M)
        tally_.visible_measured += unhidden and measured
        tally_.hidden += not unhidden
        tally_.measured_hidden += not unhidden and measured
        tally_.measured_hidden_off += not unhidden and measured and error_m > HIDDEN_OFF_M
        if not measured:
            d2 = offset @ np.linalg.solve(point.covariance[:3, :3], offset)
            tally_.covered.setdefault(when, []).append(bool(d2 <= COVERED_90))


def _steps(
    tally_: Tally,
    truth: JointTruth,
    k: int,
    known: tuple[Sequence[Footfall], Sequence[Footfall]],
    tables: GaitTables,
    own: Sequence[int],
    peers: PeerLandings,
) -> None:
    """Compare the steps of one person; `known`: true steps, and steps in the first frame."""
    falls, begun = known
    steps: list[FootStep] = [step for key in own for step in tables.steps(key)]
    begin_s = float(truth.times_s[0])
    visible = [fall for fall in falls if truth.in_view[_at(truth, fall.time_s), k]]
    taken, tally_.invented, tally_.wrong_foot = matched(
        [(begin_s + step.landed_s, step.foot) for step in steps], falls, begun
    )
    for method, walks in peers.items():
        landed = [(begin_s + time_s, foot) for key in own for time_s, foot in walks[str(key)]]
        found, invented, _ = matched(landed, falls, begun)
        count = sum(falls[n] in visible for n in found)
        tally_.peers[method] = [(count, len(visible), invented)]
    tally_.true += len(visible)
    tally_.found += sum(falls[n] in visible for n in taken)
    in_range = [
        fall for fall in visible if truth.in_range[_at(truth, fall.time_s), k, ANKLES[fall.side]]
    ]
    tally_.true_in_range += len(in_range)
    tally_.found_in_range += sum(falls[n] in in_range for n in taken)
    walked, steady_per_min = even_truth(falls), steady_cadence(falls)
    if len(visible) < WALKED_STEPS or walked is None or steady_per_min is None:
        return
    tally_.walkers += 1
    measures = [tables.measures(key) for key in own]
    best: GaitMeasures | None = max(measures, key=lambda one: one.steps, default=None)
    if best is None or best.step_length_m is None or best.cadence_per_min is None:
        return
    tally_.with_measures += 1
    tally_.length_off_m.append(best.step_length_m - walked[0])
    tally_.cadence_off.append(best.cadence_per_min / steady_per_min - 1)
    tally_.turns_cadence_off.append(best.cadence_per_min / walked[1] - 1)
    _asymmetry(tally_, falls, steps, best)


def matched(
    landed: Sequence[tuple[float, Side]], falls: Sequence[Footfall], begun: Sequence[Footfall]
) -> tuple[set[int], int, int]:
    """Match landings (time and foot) with true steps by time alone.

    Returns:
        Numbers of the found true steps, number of invented steps, number of wrong feet.
    """
    taken, invented, wrong = set[int](), 0, 0
    for landed_s, foot in sorted(landed):
        near = [
            (abs(fall.time_s - landed_s), n)
            for n, fall in enumerate(falls)
            if n not in taken and abs(fall.time_s - landed_s) < NEAR_S
        ]
        if near:
            n = min(near)[1]
            taken.add(n)
            wrong += FEET.index(foot) != falls[n].side
        else:
            invented += all(abs(fall.time_s - landed_s) >= NEAR_S for fall in begun)
    return taken, invented, wrong


def _asymmetry(
    tally_: Tally, falls: Sequence[Footfall], steps: Sequence[FootStep], best: GaitMeasures
) -> None:
    """Compare the asymmetry of step times, and the side of a limp."""
    true = true_asymmetry(falls)
    if true is None:
        return
    if best.step_time_asymmetry is not None:
        tally_.asymmetry_off.append(best.step_time_asymmetry - true)
    side = limping_side(gait_parameters(steps))
    expected = ("left" if true > 0 else "right") if abs(true) >= LIMP else None
    tally_.limps += expected is not None
    tally_.limps_found += expected is not None and side == expected
    tally_.limps_invented += side is not None and side != expected


def _live(
    tally_: Tally,
    truth: JointTruth,
    falls: Sequence[Footfall],
    people: Sequence[PersonGait | None],
) -> None:
    """Record whether frames after a third step have measures."""
    landed = [fall.time_s for fall in falls]
    for time_s, person in zip(truth.times_s, people, strict=True):
        recent = [t for t in landed if time_s - 4.0 <= t <= time_s]
        if len(recent) > WALKED_STEPS and time_s - recent[-1] < 1.0:
            tally_.live.append(person is not None and person.measures.step_length_m is not None)


def _at(truth: JointTruth, time_s: float) -> int:
    return int(np.argmin(np.abs(truth.times_s - time_s)))
