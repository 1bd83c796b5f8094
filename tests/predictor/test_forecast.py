"""Forecasts of several people: groups, habits, calibration."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from people4d.messages import F64
from services.predictor.forecast import (
    Forecast,
    Forecaster,
    PeopleState,
    apply_cohesion,
    motion_probabilities,
    unit_samples,
)
from services.predictor.groups import GroupFinder
from services.predictor.memory import ForecastMemory, Situation
from services.predictor.motion_filter import Samples

HORIZONS_S: F64 = np.arange(0.5, 5.25, 0.5)
STEP_S = 0.4


def state(
    positions: Sequence[Sequence[float]],
    velocities: Sequence[Sequence[float]],
    ids: Sequence[int] = (),
    yaws: Sequence[float] = (),
) -> PeopleState:
    """Build people of accurate positions and velocities."""
    count = len(positions)
    return PeopleState(
        ids=np.array(ids or range(1, count + 1), np.int64),
        positions_m=np.array(positions, float).reshape(-1, 2),
        velocities_mps=np.array(velocities, float).reshape(-1, 2),
        covariances_m2=np.tile(1e-4 * np.eye(2), (count, 1, 1)),
        sigma_mps=np.full(count, 0.1),
        yaws_rad=np.array(yaws or [np.nan] * count),
    )


def play(
    forecaster: Forecaster, people: Callable[[float], PeopleState], count: int, start_s: float = 0.0
) -> Forecast:
    """Forecast people at a number of times, and return the last forecast."""
    for number in range(count):
        now_s = start_s + number * STEP_S
        found = forecaster.forecast_people(now_s, people(now_s))
    return found


def find_groups(people: Callable[[float], PeopleState], count: int = 20) -> list[int]:
    """Return the groups of people after a number of times."""
    finder = GroupFinder()
    for number in range(count):
        one = people(number * STEP_S)
        groups = finder.find_groups(
            number * STEP_S, one.ids, one.positions_m, one.velocities_mps, one.yaws_rad
        )
    return [int(group) for group in groups]


def test_walking_person_continues_and_standing_person_stays() -> None:
    forecast = play(
        Forecaster(HORIZONS_S),
        lambda t: state([[t, 0.0], [3.0, 9.0]], [[1.0, 0.0], [0.0, 0.0]]),
        15,
    )
    now_m = 14 * STEP_S
    np.testing.assert_allclose(forecast.means_m[0, :, 0], now_m + HORIZONS_S, atol=0.1)
    np.testing.assert_allclose(forecast.means_m[1], [[3.0, 9.0]] * 10, atol=0.05)
    assert forecast.motion[0].argmax() == 1
    assert forecast.motion[1].argmax() == 0


def situation(identity: int, measured_m: float = 0.0) -> Situation:
    """One person at the origin, at rest."""
    return Situation(
        ids=np.array([identity]),
        positions_m=np.zeros((1, 2)),
        velocities_mps=np.zeros((1, 2)),
        standing=np.zeros(1, bool),
        displacements_m=np.zeros((1, 10, 2)),
        measured_m=np.full((1, 10, 2), measured_m),
        covariances_m2=np.tile(np.eye(2), (1, 10, 1, 1)),
    )


def test_measured_motion_counts_at_short_horizons_until_errors_are_known() -> None:
    found = ForecastMemory(HORIZONS_S).displacements(0.0, situation(1, measured_m=1.0))
    np.testing.assert_array_equal(found[0, :, 0], [1, 1, 0, 0, 0, 0, 0, 0, 0, 0])


def test_recent_errors_of_another_person_count_and_own_ones_do_not() -> None:
    # Person 1 moved 1 m in 1 s instead of 0 m. At the same position and velocity the weight is 1
    # of 1 + 5, times the trust 1 - exp(-1) at 1 s.
    memory = ForecastMemory(HORIZONS_S)
    memory.add_forecasts(0.0, np.array([1]), situation(1), np.zeros((1, 10, 2)))
    start_m, end_m = np.zeros((1, 2)), np.array([[1.0, 0.0]])
    memory.add_samples(
        Samples(np.array([1]), np.zeros(1), start_m, 1.0, end_m, np.ones(1, np.bool_))
    )
    assert memory.displacements(2.0, situation(2))[0, 1, 0] == pytest.approx((1 - np.exp(-1)) / 6)
    np.testing.assert_array_equal(memory.displacements(2.0, situation(1)), 0.0)


def test_motion_probabilities_by_hand() -> None:
    # Spread of 1 cm: at rest within 0.6 m; 3 m ahead; 3 m to the left.
    means = np.array([[0.1, 0.0], [3.0, 0.0], [0.0, 3.0]])
    covariances = np.tile(1e-4 * np.eye(2), (3, 1, 1))
    velocities = np.tile([1.0, 0.0], (3, 1))
    found = motion_probabilities(velocities, means, covariances, unit_samples())
    np.testing.assert_allclose(found, np.eye(3))


def test_people_side_by_side_are_a_group_and_passing_people_are_not() -> None:
    def people(t: float) -> PeopleState:
        positions = [[t, 0.0], [t, 0.8], [8.0 - t, 0.4], [t, 6.0]]
        return state(positions, [[1.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [1.0, 0.0]])

    one, two, passing, far = find_groups(people)
    assert one == two > 0
    assert passing == far == 0


def test_people_face_to_face_are_a_group_and_back_to_back_are_not() -> None:
    positions, rest = [[0.0, 0.0], [1.4, 0.0]], [[0.0, 0.0], [0.0, 0.0]]
    face = find_groups(lambda _: state(positions, rest, yaws=[0.0, np.pi]))
    assert face[0] == face[1] > 0
    assert find_groups(lambda _: state(positions, rest, yaws=[np.pi, 0.0])) == [0, 0]


def test_group_keeps_its_number_when_a_member_leaves_and_another_comes() -> None:
    finder = GroupFinder()
    numbers = []
    for number in range(60):
        ids = [1, 2, 3] if number < 20 else [2, 3] if number < 40 else [2, 3, 4]
        positions = [[number * 0.4, 0.7 * row] for row in range(len(ids))]
        one = state(positions, [[1.0, 0.0]] * len(ids), ids)
        numbers.append(
            finder.find_groups(
                number * STEP_S, one.ids, one.positions_m, one.velocities_mps, one.yaws_rad
            )
        )
    assert set(numbers[15].tolist()) == set(numbers[39].tolist()) == set(numbers[59].tolist())
    assert numbers[59][0] > 0


def test_cohesion_by_hand() -> None:
    displacements = np.array([[[1.0, 0.0]], [[3.0, 0.0]], [[9.0, 9.0]]])
    found = apply_cohesion(displacements, np.array([5, 5, 0]), np.array([0.5]))
    np.testing.assert_allclose(found, [[[1.5, 0.0]], [[2.5, 0.0]], [[9.0, 9.0]]])


def corner(phase_s: float) -> Callable[[float], PeopleState]:
    """Return a person walking 4 m along x and then to the left, like all people here."""

    def people(t: float) -> PeopleState:
        ahead = 1.2 * ((t - phase_s) % 8.0)
        turned = ahead > 4.0
        position = [4.0, ahead - 4.0] if turned else [ahead, 0.0]
        person = 1 + int((t - phase_s) // 8.0)
        return state([position], [[0.0, 1.2] if turned else [1.2, 0.0]], [person])

    return people


def test_habits_of_others_at_the_same_position_are_learned() -> None:
    forecaster = Forecaster(HORIZONS_S)
    play(forecaster, corner(0.0), 3)
    begun = play(Forecaster(HORIZONS_S), corner(0.0), 6)
    assert abs(begun.means_m[0, 7, 1]) < 0.1  # straight on, beyond the corner
    learned = play(forecaster, corner(0.0), 20 * 20 + 6, 1.2)
    assert learned.means_m[0, 7, 1] > 1.0


def test_ellipses_widen_until_they_hold_ninety_percent() -> None:
    # People jump 0.5 m aside at random, far more than the motion models expect.
    rng = np.random.default_rng(3)
    forecaster = Forecaster(HORIZONS_S)
    sides = rng.normal(0, 0.5, (300, 8))
    inside: list[bool] = []
    waiting: list[tuple[int, Forecast]] = []
    for number in range(300):
        now_s = number * STEP_S
        positions = [[now_s, 10.0 * row + sides[number, row]] for row in range(8)]
        people = state(positions, [[1.0, 0.0]] * 8)
        if waiting and number - waiting[0][0] == 5:  # 2 s later
            _, before = waiting.pop(0)
            error = people.positions_m - before.means_m[:, 3]
            inverse = np.linalg.inv(before.covariances_m2[:, 3])
            distance2 = np.einsum("ni,nij,nj->n", error, inverse, error)
            inside.extend((distance2 < 4.605).tolist() if number > 150 else [])
        waiting.append((number, forecaster.forecast_people(now_s, people)))
    assert 0.85 < np.mean(inside) < 0.95


def test_forecast_without_people_is_empty() -> None:
    forecast = Forecaster(HORIZONS_S).forecast_people(0.0, state([], []))
    assert forecast.means_m.shape == (0, 10, 2)


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1]])
def test_order_of_the_people_does_not_matter(order: list[int]) -> None:
    positions = np.array([[0.0, 0.0], [0.0, 0.8], [6.0, 0.4]])
    velocities = np.array([[1.0, 0.0], [1.0, 0.0], [-1.0, 0.0]])
    ids = np.array([4, 9, 2])

    def people(rows: Sequence[int]) -> Callable[[float], PeopleState]:
        return lambda t: state(
            (positions + t * velocities)[rows].tolist(),
            velocities[rows].tolist(),
            ids[rows].tolist(),
        )

    plain = play(Forecaster(HORIZONS_S), people([0, 1, 2]), 12)
    other = play(Forecaster(HORIZONS_S), people(order), 12)
    np.testing.assert_allclose(other.means_m, plain.means_m[order], atol=1e-9)
    np.testing.assert_array_equal(other.groups, plain.groups[order])
