"""Bound on the keys of a subscription."""

from people4d.session import KEY_FORGOTTEN_S, KeyLimit


def test_of_too_many_keys_the_first_go_on_and_others_are_refused() -> None:
    limit = KeyLimit(3)
    for second in range(100):
        assert all(limit.admits(key, second) for key in "abc")
        assert not limit.admits(f"invented{second}", second)


def test_key_that_was_silent_for_long_makes_room() -> None:
    limit = KeyLimit(2)
    assert limit.admits("a", 0.0)
    assert limit.admits("b", 1.0)
    assert not limit.admits("c", KEY_FORGOTTEN_S - 0.1)
    assert limit.admits("a", KEY_FORGOTTEN_S)
    assert not limit.admits("c", KEY_FORGOTTEN_S + 0.9)
    assert limit.admits("c", KEY_FORGOTTEN_S + 1.0)  # in place of b, not of a
    assert limit.admits("a", KEY_FORGOTTEN_S + 1.0)
    assert not limit.admits("b", KEY_FORGOTTEN_S + 1.0)
