"""Gallery of people: decisions, and bounds of its size."""

import numpy as np
import pytest

from common.appearance import add_view
from people4d.messages import F64
from services.tracker.strongsort3d import gallery as galleries
from services.tracker.strongsort3d.gallery import Gallery
from tests.tracker.scene import unit

S = 1_000_000_000
HERE = np.array([3.0, 0.0, 1.0])


def embedding(angle_deg: float) -> F64:
    """A unit vector; two of them differ by 1 - cos of the angle between them."""
    angle = np.deg2rad(angle_deg)
    return np.array([np.cos(angle), np.sin(angle)])


def gallery(**people_deg: float) -> Gallery:
    """Person 1, 2, ... seen here at time 0, each from one side."""
    people = Gallery(600)
    for number, angle_deg in enumerate(people_deg.values(), 1):
        people.add(number, HERE, 0, embedding(angle_deg))
    return people


def test_known_person_is_reidentified() -> None:
    # 10 degrees from person 1: 1 - cos 10 = 0.0152; 80 degrees from person 2: 0.8264. The share of
    # the weight exp(-0.0152 / 0.07) in the sum with exp(-0.25 / 0.07) and exp(-0.8264 / 0.07) is
    # 1 / (1 + exp(-3.354) + exp(-11.6)) = 0.9662.
    people = gallery(red=0, blue=90)
    decision = people.decide(embedding(10), [1, 2], 0.25)
    assert (decision.identity, decision.id) == ("reidentified", 1)
    assert decision.confidence == pytest.approx(0.9662, abs=1e-4)
    assert decision.reason == "cosine distance 0.02 to 1, 0.83 to 2"


def test_person_above_the_limit_is_new() -> None:
    # 1 - cos 45 = 0.2929 from both, more than 0.25.
    decision = gallery(red=0, blue=90).decide(embedding(45), [1, 2], 0.25)
    assert (decision.identity, decision.id) == ("new", None)
    assert decision.reason.endswith("above 0.25")


def test_nearer_of_two_similar_candidates_is_chosen_with_a_low_confidence() -> None:
    # 0.0005 from person 1 and 0.0016 from person 2: weights 0.993 and 0.978 of
    # 0.993 + 0.978 + exp(-0.25 / 0.07) = 1.999, so that 0.497 are of person 1.
    decision = gallery(twin_a=0, twin_b=5).decide(embedding(1.8), [1, 2], 0.25)
    assert (decision.identity, decision.id) == ("reidentified", 1)
    assert decision.confidence == pytest.approx(0.497, abs=0.002)


def test_of_two_similar_candidates_the_absent_one_is_chosen() -> None:
    people = gallery(twin_a=0, twin_b=5)
    candidates = people.absent(present={1})
    assert candidates == [2]
    assert people.decide(embedding(1.8), candidates, 0.25).id == 2


def test_similar_views_are_dropped_and_their_number_is_bounded() -> None:
    # 1 - cos 10 = 0.015 is the same view, 1 - cos 25 = 0.09 another one. Of nine, 0 and 25 are
    # nearest.
    views: list[F64] = []
    for angle in (0, 10, 60, 100, 140, 180, 220, 260, 300, 25):
        add_view(views, embedding(angle))
    expected = (60, 100, 140, 180, 220, 260, 300, 25)
    np.testing.assert_allclose(views, [embedding(angle) for angle in expected])


def test_longest_unseen_person_is_deleted_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(galleries, "PEOPLE_MAX", 2)
    people = Gallery(60)
    for number, time_s in ((1, 0), (2, 1), (1, 2), (3, 3)):
        people.add(number, HERE, time_s * S, unit([1, number]))
    assert list(people.entries) == [1, 3]
    people.drop_old(int(62.5 * S))
    assert list(people.entries) == [3]


def test_occluded_view_counts_until_there_is_an_unoccluded_one() -> None:
    people = gallery()
    for angle_deg, occluded in ((10, True), (20, True)):
        people.add(1, HERE, 0, embedding(angle_deg), occluded)
    np.testing.assert_array_equal(people.entries[1].views, [embedding(20)])
    people.add(1, HERE, 0, embedding(50))
    people.add(1, HERE, 0, embedding(20), occluded=True)
    people.add(1, HERE, 0, embedding(90))
    np.testing.assert_array_equal(people.entries[1].views, [embedding(50), embedding(90)])
