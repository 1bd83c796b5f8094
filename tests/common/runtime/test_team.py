"""Who lives: tokens, heartbeats, silence."""

from common.runtime.team import SILENT_S, Team


def team(**capacities: int) -> Team:
    """The team as detector-1 sees it at time 0."""
    made = Team("a")
    for name, capacity in capacities.items():
        made.came(name, capacity, 0.0)
    made.update(0.0)
    return made


def test_whoever_has_a_token_takes_turns() -> None:
    assert team(a=1, b=1).order == ("a", "b")
    assert team(b=1).order == ("b",)  # this process has not said yet that it is there
    assert team().does("front", 0) is None


def test_a_token_that_vanishes_changes_the_turns_at_once() -> None:
    two = team(a=1, b=1)
    two.went("b", 1)
    assert two.update(0.001)
    assert two.order == ("a",)
    assert not two.update(0.002)


def test_the_old_token_of_one_who_came_back_faster_does_not_count() -> None:
    two = team(a=1, b=1)
    two.came("b", 2, 0.1)
    two.went("b", 1)
    two.update(0.2)
    assert two.order == ("b", "a", "b")


def test_who_sends_no_heartbeat_is_out_until_the_next() -> None:
    two = team(a=1, b=1)
    two.heard("b", True, 1.0)
    assert not two.update(1.0 + SILENT_S - 0.01)
    assert two.update(1.0 + SILENT_S)
    assert two.order == ("a",)
    two.heard("b", True, 5.0)
    assert two.update(5.0)
    assert len(two.order) == 2


def test_a_new_token_is_a_sign_of_life() -> None:
    two = team(a=1)
    two.came("b", 1, 10.0)
    two.update(10.0 + SILENT_S - 0.01)
    assert two.order == ("a", "b")


def test_who_says_that_it_is_stalled_is_out() -> None:
    two = team(a=1, b=1)
    two.heard("b", False, 0.5)
    assert two.update(0.5)
    assert two.order == ("a",)
    two.heard("b", True, 1.0)
    assert two.update(1.0)


def test_this_process_hears_no_heartbeat_of_its_own_and_stays() -> None:
    one = team(a=1)
    one.update(100.0)
    assert one.order == ("a",)


def test_a_capacity_out_of_range_is_nobody() -> None:
    assert team(a=1, b=0, c=101).order == ("a",)


def test_a_heartbeat_without_a_token_is_nobody() -> None:
    one = team(a=1)
    one.heard("b", True, 0.0)
    assert not one.update(0.0)


def test_time_in_which_this_process_was_stopped_is_nobodys_silence() -> None:
    two = team(a=1, b=1)
    two.excuse(60.0)
    assert not two.update(60.0 + SILENT_S - 0.01)
    assert two.update(60.0 + SILENT_S)
