"""Who does which message, worked out by hand."""

import itertools
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.runtime.assignment import owner, turns

teams = st.dictionaries(
    st.text("abcdefgh", min_size=1, max_size=3), st.integers(1, 9), min_size=1, max_size=6
)


def test_equal_members_take_turns() -> None:
    assert turns({"b": 1, "a": 1}) == ("a", "b")
    assert turns({"c": 1, "a": 1, "b": 1}) == ("a", "b", "c")


def test_only_the_ratio_of_capacities_counts() -> None:
    assert turns({"a": 4, "b": 4}) == ("a", "b")
    assert turns({"a": 6, "b": 3}) == turns({"a": 2, "b": 1})


def test_turns_of_a_faster_member_are_spread() -> None:
    # Credits before each turn, a gains 2, b 1, a turn costs 3:
    # (2, 1) a -> (-1, 1); (1, 2) b -> (1, -1); (3, 0) a -> (0, 0).
    assert turns({"a": 2, "b": 1}) == ("a", "b", "a")
    # (5, 1, 1) a -> (-2, 1, 1); (3, 2, 2) a -> (-4, 2, 2); (1, 3, 3) b -> (1, -4, 3);
    # (6, -3, 4) a -> (-1, -3, 4); (4, -2, 5) c -> (4, -2, -2); (9, -1, -1) a -> (2, -1, -1);
    # (7, 0, 0) a -> (0, 0, 0).
    assert turns({"a": 5, "b": 1, "c": 1}) == ("a", "a", "b", "a", "c", "a", "a")


def test_nobody_is_there() -> None:
    assert owner(turns({}), "front", 0) is None


@given(teams, st.integers(0, 2**53 - 1), st.text("xyz", min_size=1, max_size=5))
def test_every_round_gives_everyone_their_share(
    team: dict[str, int], start: int, camera: str
) -> None:
    order = turns(team)
    counts = Counter(str(owner(order, camera, start + k)) for k in range(len(order)))
    total = sum(team.values())
    assert set(counts) == set(team)
    for name, count in counts.items():
        assert count * total == team[name] * len(order)


@given(st.dictionaries(st.text("abcd", min_size=1), st.just(1), min_size=2, max_size=8))
def test_equal_members_never_do_two_in_a_row(team: dict[str, int]) -> None:
    order = turns(team)
    owners = [owner(order, "front", k) for k in range(3 * len(order))]
    assert all(a != b for a, b in itertools.pairwise(owners))


@given(teams)
def test_nobody_waits_longer_than_their_share_demands(team: dict[str, int]) -> None:
    # In k turns in a row everyone gets their k * share, to within less than one turn at either end.
    order = turns(team)
    for name in team:
        share = order.count(name) / len(order)
        for first in range(len(order)):
            for length in range(1, len(order)):
                got = [order[(first + k) % len(order)] for k in range(length)].count(name)
                assert abs(got - share * length) < 2


@given(teams, st.randoms())
def test_the_order_in_which_members_were_heard_of_does_not_matter(
    team: dict[str, int], chance: object
) -> None:
    names = list(team)
    chance.shuffle(names)  # type: ignore[attr-defined]
    assert turns({name: team[name] for name in names}) == turns(team)


@pytest.mark.parametrize("cameras", [("front", "rear"), ("left", "right"), ("a", "b")])
def test_cameras_in_step_share_both_members(cameras: tuple[str, str]) -> None:
    order = turns({"detector-1": 1, "detector-2": 1})
    owners = Counter(owner(order, camera, k) for camera in cameras for k in range(100))
    assert set(owners.values()) == {100}
