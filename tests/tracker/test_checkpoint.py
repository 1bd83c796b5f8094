"""A tracker that goes on in another process."""

from typing import Any

import numpy as np
import pytest

from people4d.errors import DecodeError
from people4d.messages import Track
from services.tracker.build import make_tracker
from services.tracker.interface import Tracker
from services.tracker.strongsort3d.config import IdentityConfig
from tests.tracker.scene import frame, person, published, published_config

RED, BLUE = (1.0, 0.0, 0.1), (0.0, 1.0, 0.1)
IDENTITY = published(
    identity=IdentityConfig(enabled=True),
    visibility=True,
)
CONFIGS = {
    "sort3d": published_config(tracker="sort3d"),
    "strongsort3d": published_config(),
    "identity": published_config(strongsort3d=IDENTITY, yaw="keypoints"),
}


def tracker(name: str) -> Any:
    made = make_tracker(CONFIGS[name])
    assert made.ids
    return made


def walk(target: Tracker, numbers: range) -> list[list[Track]]:
    """Two people walk towards the camera, 1 m/s."""
    return [
        target.update(
            frame(
                k,
                person(5.0 - 0.1 * k, -1.0, 0, embedding=RED),
                person(6.0 - 0.1 * k, 1.0, 1, embedding=BLUE),
            )
        )
        for k in numbers
    ]


@pytest.mark.parametrize("name", CONFIGS)
def test_restored_tracker_continues_identically(name: str) -> None:
    first, second = tracker(name), tracker(name)
    walk(first, range(10))
    second.restore(first.save())
    for expected, got in zip(walk(first, range(10, 15)), walk(second, range(10, 15)), strict=True):
        assert [t.id for t in got] == [t.id for t in expected] == [1, 2]
        for a, b in zip(expected, got, strict=True):
            np.testing.assert_allclose(b.position_m, a.position_m)
            np.testing.assert_allclose(b.covariance, a.covariance)
            assert (b.hits, b.age, b.state, b.yaw_rad) == (a.hits, a.age, a.state, a.yaw_rad)
            assert (b.identity, b.identity_reason) == (a.identity, a.identity_reason)


@pytest.mark.parametrize("name", ["strongsort3d", "identity"])
def test_people_who_stood_nearly_still_for_two_seconds_keep_their_identities(name: str) -> None:
    first, second = tracker(name), tracker(name)
    for k in range(10):
        first.update(
            frame(k, person(4.0, -1.0, embedding=RED), person(4.0, 1.0, 1, embedding=BLUE))
        )
    second.restore(first.save())
    # Of two detections of the same score the one to the left, at y = 1, began first.
    before = {1: 1, 2: -1}
    # 2 s later, 0.3 m on, in another order.
    blue, red = person(4.3, 1.0, 0, embedding=BLUE), person(3.7, -1.0, 1, embedding=RED)
    for k in range(29, 35):
        results = second.update(frame(k, blue, red))
    assert {t.id: round(float(t.position_m[1])) for t in results} == before


@pytest.mark.parametrize("name", CONFIGS)
def test_identity_of_a_deleted_track_is_not_given_again(name: str) -> None:
    first, second = tracker(name), tracker(name)
    walk(first, range(5))
    for k in range(100, 103):  # ten seconds later, out of reach
        (results,) = first.update(frame(k, person(8.0, 3.0, embedding=(0.0, 0.1, 1.0))))
    assert results.id == 3
    first.update(frame(200))  # and gone
    second.restore(first.save())
    for k in range(300, 303):
        (results,) = second.update(frame(k, person(3.0, 0.0, embedding=(0.5, 0.5, 0.0))))
    assert results.id == 4


def test_person_is_reidentified_after_a_restart() -> None:
    first, second = tracker("identity"), tracker("identity")
    walk(first, range(10))
    for k in range(10, 60):
        first.update(frame(k))
    second.restore(first.save())
    for k in range(60, 70):
        results = second.update(frame(k, person(4.0, -1.0, embedding=RED)))
    assert [(t.id, t.identity) for t in results] == [(2, "continued")]  # red, to the right


def test_damaged_or_foreign_checkpoint_is_refused_without_effect() -> None:
    good = tracker("strongsort3d")
    walk(good, range(5))
    saved = good.save()
    for bad in (b"", saved[:-1], b"\x80", tracker("sort3d").save(), bytes(range(256))):
        target = tracker("strongsort3d")
        with pytest.raises(DecodeError, match="checkpoint"):
            target.restore(bad)
        assert walk(target, range(3))[-1][0].id == 1
        assert target.ids.next == 3


def test_states_of_another_length_are_refused() -> None:
    # Six numbers of position and velocity where SORT-3D has thirteen.
    strong = tracker("strongsort3d")
    walk(strong, range(5))
    with pytest.raises(DecodeError, match="expected states of 13 numbers"):
        tracker("sort3d").restore(strong.save().replace(b"\xacstrongsort3d", b"\xa6sort3d"))
