"""Gait parameters of walks by hand, and their page."""

from dataclasses import replace

import numpy as np
import pytest

from common.drawing.topdown import Trajectories
from evaluation.gait.parameters import (
    GaitParameter,
    gait_parameters,
    limping_side,
    recognisable_limp,
)
from evaluation.gait.person_page import person_page
from services.gait.steps.steps import FootStep, Side, Stride, gait_measures
from tests.gait.steps.test_steps import feet, found_steps

# Of people of another simulator: step time, its variation, and errors of landings
STEP_S, VARIATION_S, LANDING_S = 0.58, 0.03, 0.05


def walk(duration_s: float = 8.0, **swings_s: float) -> dict[str, GaitParameter]:
    times_s = np.arange(0, duration_s, 1 / 30)
    left, right = feet(times_s, **swings_s)
    steps = found_steps(left, right, times_s)
    return {one.name: one for one in gait_parameters(steps)}


@pytest.mark.parametrize(
    ("name", "value", "tolerance"),
    [
        ("step length", 0.6, 0.01),
        ("left step length", 0.6, 0.02),
        ("right step length", 0.6, 0.02),
        ("stride length", 1.2, 0.01),
        ("step width", 0.2, 0.01),
        ("cadence", 120.0, 1.0),
        ("speed", 1.2, 0.02),
        ("step time asymmetry", 0.0, 3.0),
    ],
)
def test_even_walk_by_hand(name: str, value: float, tolerance: float) -> None:
    # Steps of 0.6 m in 0.5 s with feet 0.2 m apart.
    one = walk()[name]
    assert one.value == pytest.approx(value, abs=tolerance)
    assert None not in (one.low, one.value, one.high)
    assert sorted([one.low or 0, one.value or 0, one.high or 0]) == [one.low, one.value, one.high]
    assert one.count >= 6


def test_mean_length_is_that_of_the_measures_and_weighted_by_confidence() -> None:
    times_s = np.arange(0, 8, 1 / 30)
    left, right = feet(times_s)
    steps = found_steps(left, right, times_s)
    assert steps[-1].stride is not None
    unsure = replace(steps[-1].stride, length_m=0.6, confidence=0.3)
    steps[-1] = replace(steps[-1], stride=unsure)
    one = {p.name: p for p in gait_parameters(steps)}["stride length"]
    assert one.value == pytest.approx(gait_measures(steps).stride_length_m)
    certain = replace(steps[-1], stride=replace(unsure, confidence=1.0))
    other = {p.name: p for p in gait_parameters([*steps[:-1], certain])}
    # A deviating stride of lower weight widens the interval less.
    low, high = other["stride length"].low, other["stride length"].high
    assert None not in (one.low, one.high, low, high)
    assert (one.high or 0) - (one.low or 0) < (high or 0) - (low or 0)


def test_interval_of_the_cadence_is_that_of_the_steps_it_is_of() -> None:
    times_s = np.arange(0, 8, 1 / 30)
    left, right = feet(times_s)
    steps = found_steps(left, right, times_s)
    last = steps[-1]
    stop = replace(last, landed_s=last.landed_s + 1.4, follows=False)
    walked, stopped = (
        {p.name: p for p in gait_parameters(some)}["cadence"] for some in (steps, [*steps, stop])
    )
    assert (stopped.low, stopped.value, stopped.high) == (walked.low, walked.value, walked.high)


def test_shares_of_a_stride_add_up() -> None:
    # Each foot swings for half of the time, at constant speed, once the other foot has landed.
    found = walk()
    stance, swing = found["stance"].value or 0.0, found["swing"].value or 0.0
    assert swing == pytest.approx(45.0, abs=3.0)  # 50 %, less the first 10 % of the path
    assert stance + swing == pytest.approx(100.0)
    assert found["double support"].value == pytest.approx(2 * (50 - 45.0), abs=4.0)


def test_interval_of_a_share_is_within_it() -> None:
    # One stride of each foot, with different swing times: the interval would exceed 0 to 100 %.
    found = walk(2.5, left_swing_s=0.3, right_swing_s=0.7)
    for name in ("stance", "swing"):
        assert (found[name].count, found[name].low, found[name].high) == (2, 0.0, 100.0)


@pytest.mark.parametrize(
    ("left_s", "right_s", "side"), [(0.525, 0.475, "left"), (0.45, 0.55, "right"), (0.5, 0.5, None)]
)
def test_limp_has_its_side(left_s: float, right_s: float, side: str | None) -> None:
    """Asymmetries of 10 and 20 %: the limping foot swings longer than the other foot."""
    found = walk(left_swing_s=left_s, right_swing_s=right_s)
    assert limping_side(list(found.values())) == side
    assert found["step time asymmetry"].value == pytest.approx(200 * (left_s - right_s), abs=4.0)


def test_few_steps_give_no_intervals() -> None:
    found = walk(1.9)
    assert found["cadence"].count == 2  # times of steps, of one stride
    assert found["cadence"].value == pytest.approx(120, abs=3)
    assert found["stride length"].count == 1
    assert found["stride length"].low is None
    assert limping_side(list(found.values())) is None


def test_person_who_stands_has_no_parameters() -> None:
    parameters = gait_parameters([])
    assert {one.value for one in parameters} == {None}
    page = person_page(3, parameters, [], Trajectories())
    assert "No steps were found" in page


def test_page_contains_everything_and_loads_nothing() -> None:
    times_s = np.arange(0, 6, 1 / 30)
    left, right = feet(times_s)
    steps = found_steps(left, right, times_s)
    page = person_page(7, gait_parameters(steps), steps, Trajectories(tracks={7: left[:, :2]}))
    assert "Gait of person 7" in page
    assert "steps in 5 s, 0.60 m a step, 120 steps a minute, 1.20 m/s. No limp is seen" in page
    assert page.count("<svg") == 3
    assert "double support" in page
    assert not [
        word
        for word in ("$", "src=", "http://", "https://")
        if word in page.replace("http://www.w3.org/2000/svg", "").replace('src="data:', "")
    ]


def limp(ratio: float, duration_s: float, seed: int) -> str | None:
    """Return the limping side of a straight walk; its landings vary and are found to 0.05 s."""
    generator = np.random.default_rng(seed)
    count = int(duration_s / STEP_S)
    own_s = np.where(np.arange(count) % 2, 1 - ratio / 2, 1 + ratio / 2) * STEP_S
    own_s += generator.normal(0, VARIATION_S, count)
    landed_s = np.cumsum(own_s) + generator.normal(0, LANDING_S, count)
    steps: list[FootStep] = []
    for k, time_s in enumerate(landed_s.tolist()):
        stride = None
        if k > 1:
            stride = Stride(1.2, time_s - steps[-2].landed_s, time_s - steps[-1].landed_s)
        foot: Side = "right" if k % 2 else "left"
        step = FootStep(foot, time_s, 0.6, stride, time_s - 0.4, (0.6 * k, 0.0), 0.2, 1.0, k > 0)
        steps.append(step)
    return limping_side(gait_parameters(steps))


@pytest.mark.parametrize(("ratio", "duration_s"), [(0.1, 120.0), (0.2, 30.0)])
def test_limp_is_recognised_in_a_walk_that_is_long_enough(ratio: float, duration_s: float) -> None:
    found = [limp(ratio, duration_s, seed) for seed in range(40)]
    assert found.count("left") >= 30
    assert "right" not in found


def test_more_steps_show_smaller_limps() -> None:
    short, long = (recognisable_limp(list(walk(s).values())) for s in (6.0, 30.0))
    assert short is not None
    assert long == 5.0 <= short
    assert recognisable_limp(list(walk(1.9).values())) is None


@pytest.mark.parametrize("duration_s", [6.0, 25.0, 90.0])
def test_healthy_people_rarely_limp(duration_s: float) -> None:
    found = [limp(0.0, duration_s, seed) for seed in range(40)]
    assert found.count(None) >= 35
