"""Engagement of people who face the robot, or look away."""

import math

import numpy as np
import pytest

from people4d.messages import Track
from services.ros2_bridge.engagement import (
    DISENGAGED,
    DISENGAGING,
    ENGAGED,
    ENGAGING,
    UNKNOWN,
    Engagement,
)
from tests import builders

ROBOT_M = np.zeros(3)
FACING, AWAY = math.pi, 0.0  # yaws of a person at x = 2 m


def person(yaw_rad: float | None, x_m: float = 2.0, **fields: str) -> Track:
    return builders.track(id=1, position_m=np.array([x_m, 0, 1.0]), yaw_rad=yaw_rad, **fields)


def levels(yaws_rad: list[float], x_m: float = 2.0) -> list[int]:
    """Return the levels of one person in frames that are a second apart."""
    engagement = Engagement()
    return [
        engagement.update(builders.tracks(person(yaw_rad, x_m), stamp_ns=number * 10**9), ROBOT_M)[
            1
        ]
        for number, yaw_rad in enumerate(yaws_rad)
    ]


def test_person_is_engaged_after_three_seconds_and_disengaged_after_three_others() -> None:
    found = levels([AWAY] + 5 * [FACING] + 5 * [AWAY])
    begin = [DISENGAGED] + 3 * [ENGAGING] + 2 * [ENGAGED]
    assert found == begin + 3 * [DISENGAGING] + 2 * [DISENGAGED]


def test_turning_away_briefly_does_not_disengage() -> None:
    assert levels(4 * [FACING] + [AWAY] + [FACING])[-2:] == [DISENGAGING, ENGAGED]


def test_person_far_away_is_disengaged() -> None:
    assert set(levels(5 * [FACING], x_m=4.5)) == {DISENGAGED}


@pytest.mark.parametrize(
    ("track", "robot_m"),
    [
        (person(None), ROBOT_M),
        (person(FACING), None),
        (person(FACING, state="lost"), ROBOT_M),
    ],
)
def test_level_is_unknown_without_yaw_robot_or_detection(
    track: Track, robot_m: np.ndarray | None
) -> None:
    assert Engagement().update(builders.tracks(track), robot_m) == {1: UNKNOWN}
