"""What is remembered of people, and who is known again."""

import numpy as np
import pytest

from people4d.messages import F64
from services.tracker.identity.config import IdentityConfig
from services.tracker.identity.gallery import Gallery, Newcomer, add_view
from tests.tracker.scene import unit

S = 1_000_000_000
HERE = np.array([3.0, 0.0, 1.0])


def look(angle_deg: float) -> F64:
    """A unit vector; two of them differ by 1 - cos of the angle between them."""
    angle = np.deg2rad(angle_deg)
    return np.array([np.cos(angle), np.sin(angle)])


def gallery(**people_deg: float) -> Gallery:
    """Person 1, 2, ... seen here at time 0, each from one side."""
    shown = Gallery(IdentityConfig())
    for number, angle_deg in enumerate(people_deg.values(), 1):
        shown.see(number, HERE, 0, look(angle_deg))
    return shown


def newcomer(*angles_deg: float, time_s: float = 10) -> Newcomer:
    return Newcomer(HERE, int(time_s * S), [look(a) for a in angles_deg])


def test_a_known_person_is_known_again() -> None:
    # 10 degrees from person 1: 1 - cos 10 = 0.0152; 80 degrees from person 2: 0.8264. Of the
    # weights exp(-0.0152 / 0.04), exp(-0.25 / 0.04) and that of person 2 the first is
    # 1 / (1 + exp(-5.87)) = 0.9972.
    shown = gallery(red=0, blue=90)
    decision = shown.decide(newcomer(10), [1, 2], 0.25)
    assert (decision.kind, decision.id) == ("reidentified", 1)
    assert decision.confidence == pytest.approx(0.9972, abs=1e-4)
    assert decision.reason == "looks 0.02 from 1, 0.83 from 2"


def test_several_pictures_count_by_their_mean() -> None:
    # One of three pictures is 60 degrees off; the mean of 0, 0 and 60 is at 19.1: 0.055.
    decision = gallery(red=0, blue=90).decide(newcomer(0, 0, 60), [1, 2], 0.25)
    assert (decision.kind, decision.id) == ("reidentified", 1)
    assert "0.06 from 1" in decision.reason


def test_a_stranger_is_new() -> None:
    # 1 - cos 45 = 0.2929 from both, more than 0.25.
    decision = gallery(red=0, blue=90).decide(newcomer(45), [1, 2], 0.25)
    assert (decision.kind, decision.id) == ("new", None)
    assert decision.reason.endswith("above 0.25")


def test_of_two_alike_nobody_is_chosen() -> None:
    # 0.0004 from person 1 and 0.0015 from person 2: less apart than the margin of 0.05.
    decision = gallery(twin_a=0, twin_b=5).decide(newcomer(1.8), [1, 2], 0.25)
    assert (decision.kind, decision.id) == ("refused", None)
    assert decision.confidence == pytest.approx(0.5, abs=0.05)
    assert decision.reason.endswith("too alike")


def test_of_two_alike_the_absent_one_is_chosen() -> None:
    shown = gallery(twin_a=0, twin_b=5)
    who = shown.plausible(newcomer(1.8), present={1})
    assert who == [2]
    assert shown.decide(newcomer(1.8), who, 0.25).id == 2


def test_nobody_moves_faster_than_people_do() -> None:
    # 6 m away: within 0.8 + 2.5 t from t = 2.08 s on.
    shown = gallery(red=0)
    far = HERE + np.array([0, 6, 0])
    assert shown.plausible(Newcomer(far, 2 * S, [look(0)]), present=()) == []
    assert shown.plausible(Newcomer(far, int(2.1 * S), [look(0)]), present=()) == [1]


def test_only_different_views_are_kept_and_only_so_many() -> None:
    # 1 - cos 10 = 0.015 is no other view, 1 - cos 20 = 0.06 is. Of five, 0 and 30 are most alike.
    views: list[F64] = []
    for angle in (0, 10, 90, 180, 30, 270):
        add_view(views, look(angle), gap=0.03, most=4)
    np.testing.assert_allclose(views, [look(90), look(180), look(30), look(270)])


def test_who_was_not_seen_for_longest_is_forgotten_first() -> None:
    shown = Gallery(IdentityConfig(identities=2, keep_s=60))
    for number, time_s in ((1, 0), (2, 1), (1, 2), (3, 3)):
        shown.see(number, HERE, time_s * S, unit([1, number]))
    assert list(shown.people) == [1, 3]
    shown.forget_old(int(62.5 * S))
    assert list(shown.people) == [3]
