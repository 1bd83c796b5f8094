"""Gallery of people: views, and bounds of its size."""

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
