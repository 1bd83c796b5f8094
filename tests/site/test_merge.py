"""People of several areas: each identity and each person once."""

from typing import Any

import numpy as np
import pytest

from people4d.messages import Track
from services.site.merge import merge, predicted
from tests import builders


def track(number: int, x: float, **fields: Any) -> Track:
    position_m = np.array([x, 0.0, 1.0])
    return builders.track(**{"id": number, "position_m": position_m, "detection": 0, **fields})


def test_people_of_all_areas_are_there() -> None:
    merged = merge({"a": [track(1, 0.0)], "b": [track(2, 3.0)]})
    assert [t.id for t in merged.tracks] == [1, 2]
    assert (merged.doubles, merged.conflicts) == (0, 0)


def test_of_an_identity_the_track_that_was_measured_last_counts() -> None:
    left = track(1, 0.0, detection=None, time_since_update_s=1.5, state="lost")
    merged = merge({"a": [left], "b": [track(1, 2.0, time_since_update_s=0.0)]})
    (only,) = merged.tracks
    assert only.position_m[0] == 2.0


def test_person_of_two_identities_has_that_of_the_longer_track() -> None:
    merged = merge({"a": [track(1, 0.0, hits=9)], "b": [track(2, 0.3, hits=50)]})
    assert [t.id for t in merged.tracks] == [2]
    assert merged.doubles == 1


def test_two_people_of_one_area_who_touch_are_two() -> None:
    merged = merge({"a": [track(1, 0.0), track(2, 0.3)]})
    assert len(merged.tracks) == 2


def test_identity_used_for_two_people_is_that_of_the_longer_track() -> None:
    merged = merge({"a": [track(1, 0.0, hits=9)], "b": [track(1, 5.0, hits=50)]})
    (only,) = merged.tracks
    assert only.position_m[0] == 5.0
    assert merged.conflicts == 1


def test_prediction_moves_at_the_velocity() -> None:
    moving = track(1, 0.0, velocity_mps=np.array([2.0, 0.0, 0.0]), covariance=np.eye(6))
    later = predicted(moving, 0.5)
    assert later.position_m[0] == 1.0
    # Of x: 1 + 0.5^2 x 1.
    assert later.covariance[0, 0] == pytest.approx(1.25)
