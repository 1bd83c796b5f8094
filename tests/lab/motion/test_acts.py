"""Acts of a standing person."""

import numpy as np
import pytest

from lab.motion.acts import ACTS, down_s, end_s, is_fall, posture
from lab.motion.motion import PersonMotion, simulate
from lab.scenario import Act, PersonPlan
from tests.lab.motion.joint_positions import joints
from tests.lab.motion.skeletons import skeleton


def act_of(move: str) -> Act:
    return Act(at_s=1.0, move=move, move_s=1.0, for_s=2.0)  # type: ignore[arg-type]


def motion(act: Act) -> PersonMotion:
    plan = PersonPlan(body="adam", start=(1.0, 2.0), acts=(act,))
    return simulate([plan], [skeleton()], end_s(act) + 1, 0)[0]


@pytest.mark.parametrize("move", ACTS)
def test_act_keeps_the_person_on_the_floor_and_ends_standing(move: str) -> None:
    act = act_of(move)
    found = joints(motion(act), skeleton(), np.arange(0.0, end_s(act) + 0.5, 0.05))
    lowest_m = np.concatenate([found.hip, found.knee, found.ankle, found.shoulder], axis=1)[..., 2]
    assert -0.01 < lowest_m.min() < 0.12
    # The feet stay in place, the torso returns to where it was.
    feet_m = found.ankle[..., :2].mean(axis=1)
    assert np.abs(feet_m - feet_m[0]).max() < 0.05
    assert found.torso[-1] == pytest.approx(found.torso[0], abs=0.02)


def test_postures_have_different_heights_of_the_torso() -> None:
    heights_m = {}
    for move in ("sit", "fall_back", "lie_in_bed", "bend"):
        act = act_of(move)
        found = joints(motion(act), skeleton(), np.array([0.5, down_s(act) + 0.5]))
        heights_m[move] = found.torso[0, 2] - found.torso[1, 2]
    assert 0.3 < heights_m["sit"] < 0.55
    assert heights_m["fall_back"] > 0.8
    assert heights_m["fall_back"] - heights_m["lie_in_bed"] == pytest.approx(0.5, abs=0.15)
    assert heights_m["bend"] < 0.3


def test_fall_accelerates_and_lying_down_is_slow() -> None:
    fastest_mps = {}
    for move in ("fall_forward", "lie"):
        act = act_of(move)
        times_s = np.arange(0.5, down_s(act), 0.05)
        heights_m = joints(motion(act), skeleton(), times_s).torso[:, 2]
        fastest_mps[move] = -np.diff(heights_m).min() / 0.05
    assert fastest_mps["fall_forward"] > 1.3 > fastest_mps["lie"]


def test_posture_is_unknown_while_it_changes() -> None:
    act = act_of("fall_left")
    assert is_fall(act)
    assert [posture((act,), t) for t in (0.5, 1.5, 2.5, 3.9, 4.5, 6.0)] == [
        *("standing", None, "lying", "lying", None, "standing")
    ]


def test_same_seed_gives_the_same_act() -> None:
    first, second = (motion(act_of("squat")).at(3.0) for _ in range(2))
    assert np.array_equal(first.rotations, second.rotations)
