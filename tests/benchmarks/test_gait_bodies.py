"""Comparison of points of tracked people with joints: pairs of people, worst style."""

from dataclasses import dataclass

import numpy as np

from benchmarks.gait_bodies import worst_style
from benchmarks.lib.gait.bodies import JointTruth, tally
from benchmarks.lib.gait.tally import Tally
from people4d.messages import BodyPoint, GaitMeasures, PersonGait

PEOPLE_X_M = (0.0, 0.4)


@dataclass(frozen=True)
class Result:
    """Published record of a person, all that is compared."""

    person: PersonGait


def estimate(number: int, x_m: float, state: str) -> Result:
    points = tuple(
        BodyPoint(
            name=name,
            state=state,  # type: ignore[arg-type]
            position_m=np.array([x_m, 0.0, height_m]),
            velocity_mps=np.zeros(3),
            covariance=np.eye(6),
            confidence=1.0,
        )
        for name, height_m in (("head", 1.6), ("left_hand", 0.8))
    )
    return Result(PersonGait(id=number, points=points, measures=GaitMeasures()))


def test_hidden_person_is_not_compared_with_the_one_before_them() -> None:
    # Person 1 walks behind person 0, is hidden, and is predicted at the position of person 0.
    joints_m = np.zeros((2, 2, 17, 3))
    joints_m[..., 0] = np.array(PEOPLE_X_M)[:, None]
    joints_m[..., 2] = 1.0
    visible = np.ones((2, 2, 17), bool)
    visible[1, 1] = False
    every = np.ones((2, 2), bool)
    truth = JointTruth(
        np.array([0.0, 0.1]), joints_m, visible, np.tile((-3.0, 0.0, 1.0), (2, 1)), every, visible
    )
    first = [estimate(7, 0.0, "measured"), estimate(8, 0.4, "measured")]
    second = [estimate(7, 0.1, "measured"), estimate(8, 0.0, "predicted")]
    near, hidden = tally(truth, [first, second], [0, 100_000_000])  # type: ignore[list-item]
    assert near.visible_measured == 2
    assert hidden.hidden == 1
    assert hidden.measured_hidden == 0


def test_worst_style_has_the_largest_share_of_missed_and_false_steps() -> None:
    """Slow: 10 - 9 + 2 = 3 of 10. Limping: 1 of 10. Scenes of the tuning split do not count."""
    styles = {
        ("slow", "judge"): [Tally(true=10, found=9, invented=2)],
        ("limping", "judge"): [Tally(true=10, found=9)],
        ("fast", "choose"): [Tally(true=10, found=1)],
    }
    assert worst_style(styles) == "Worst style of `judge`: slow, 9 of 10 steps, 2 false."


def test_tuning_scenes_alone_have_no_worst_style() -> None:
    assert worst_style({("fast", "choose"): [Tally(true=10, found=1)]}) == ""
