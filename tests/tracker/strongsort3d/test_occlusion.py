"""People hidden behind others keep their tracks."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL
from people4d.messages import Track
from services.tracker.config import StrongSort3dConfig, TrackerConfig
from services.tracker.identity.config import OcclusionConfig
from services.tracker.interface import Measurement, Observation
from services.tracker.strongsort3d.occlusion import Fading, columns, emergence_m, hidden, shares
from services.tracker.strongsort3d.strongsort3d import StrongSort3d
from tests.tracker.scene import frame, person

RED, BLUE = (1.0, 0.1, 0.0), (0.0, 0.1, 1.0)


def placed(number: int, *people: Measurement) -> Observation:
    """A frame of a camera at the origin of the map that looks along +x."""
    observation = frame(number, *people)
    return dataclasses.replace(observation, map_from_camera=LINK_FROM_OPTICAL, size_px=(640, 480))


def tracker(occlusion: OcclusionConfig, a_max: int = 5) -> StrongSort3d:
    strong = StrongSort3dConfig(occlusion=occlusion, a_max=a_max)
    return StrongSort3d(TrackerConfig(strongsort3d=strong))


def of(tracks: list[Track], number: int) -> Track:
    return next(track for track in tracks if track.id == number)


def test_who_is_hidden() -> None:
    # Strips, half a width of 0.25 m: A at 2 m covers -0.125 to 0.125; B at 4 m and 0.1 m to the
    # left is -0.0875 to 0.0375, all of it covered; C at 4 m, 0.6 m to the right, is 0.0875 to
    # 0.2125, of which 0.0375 / 0.125 = 0.3 are covered; D at 1.5 m is before A.
    people = np.array([[2, 0, 1], [4, 0.1, 1], [4, -0.6, 1], [1.5, 0, 1.0]])
    seen = np.array([True, False, False, False])
    told = hidden(people, seen, LINK_FROM_OPTICAL, OcclusionConfig(covered_min=0.4))
    assert told.tolist() == [False, True, False, False]
    told = hidden(people, seen, LINK_FROM_OPTICAL, OcclusionConfig(covered_min=0.29))
    assert told.tolist() == [False, True, True, False]


def test_how_much_of_a_strip_another_one_covers() -> None:
    # At 2 m, half a width of 0.25 m covers -0.125 to 0.125; at 4 m and 0.5 m to the left -0.1875 to
    # -0.0625. They share 0.0625: a quarter of the first, half of the second.
    strips, depth_m = columns(np.array([[2, 0, 1], [4, 0.5, 1.0]]), LINK_FROM_OPTICAL, 0.25)
    np.testing.assert_allclose(strips, [[-0.125, 0.125], [-0.1875, -0.0625]])
    np.testing.assert_allclose(depth_m, [2, 4])
    np.testing.assert_allclose(shares(strips, strips), [[1, 0.25], [0.5, 1]])


def test_how_far_people_are_from_where_they_could_have_been_hidden() -> None:
    # A at 2 m, strip -0.125 to 0.125; B at 4 m and 1 m to the right, 0.1875 to 0.3125: between A
    # and B 0.0625, at 4 m 0.25 m. C at 4 m straight behind A. Nobody stands before A but C and B
    # are as near as each other: from C's strip, to 0.0625, B is 0.125 * 4 = 0.5 m away.
    found = np.array([[2, 0, 1], [4, -1, 1], [4, 0, 1.0]])
    told = emergence_m(found, LINK_FROM_OPTICAL, OcclusionConfig(half_width_m=0.25))
    np.testing.assert_allclose(told, [np.inf, 0.25, 0.0])


def test_nobody_is_hidden_by_somebody_who_is_not_seen() -> None:
    people = np.array([[2, 0, 1], [4, 0, 1.0]])
    told = hidden(people, np.zeros(2, np.bool_), LINK_FROM_OPTICAL, OcclusionConfig())
    assert not told.any()


def test_velocity_fades_and_its_uncertainty_comes_back() -> None:
    # dt = tau ln 2: k = 1/2. v: 1 -> 0.5; its variance 0.04 -> 0.25 * 0.04 + 0.75 * 0.36 = 0.28;
    # its covariance with the position 0.02 -> 0.01; up and down only 0.25 * 0.04 = 0.01.
    fading = Fading(OcclusionConfig(velocity_decay_s=0.7, walk_sigma_mps=0.6), [3, 4, 5])
    x = np.array([[3, 0, 1, 1, 0, 0.0]] * 2)
    P = np.array([0.04 * np.eye(6)] * 2)
    P[:, 0, 3] = P[:, 3, 0] = 0.02
    after, covariance = fading(x, P, np.array([True, False]), 0.7 * math.log(2))
    expected = np.array([[3, 0, 1, 0.5, 0, 0], [3, 0, 1, 1, 0, 0.0]])
    np.testing.assert_allclose(after, expected)
    np.testing.assert_allclose(np.diag(covariance[0]), [0.04, 0.04, 0.04, 0.28, 0.28, 0.01])
    assert covariance[0, 0, 3] == pytest.approx(0.01)
    np.testing.assert_array_equal(covariance[1], P[1])


def crossing(sort: StrongSort3d) -> list[list[Track]]:
    """B walks behind A, who stands, and is not seen for 1 s, from frame 13 to 22."""
    told = []
    for number in range(30):
        y = -1.2 + 0.06 * number
        people = [person(2.5, -0.1, embedding=RED)]
        if not 13 <= number < 23:
            people.append(person(4, y, index=1, embedding=BLUE))
        told.append(sort.update(placed(number, *people)))
    return told


def test_a_person_hidden_for_a_second_keeps_the_track() -> None:
    told = crossing(tracker(OcclusionConfig(enabled=True)))
    lost = [of(tracks, 2) for tracks in told[13:23]]
    assert all(track.state == "lost" and track.detection is None for track in lost)
    sizes = [float(np.trace(track.covariance[:2, :2])) for track in lost]
    assert all(later > earlier for earlier, later in itertools.pairwise(sizes))
    speeds = [float(np.linalg.norm(track.velocity_mps)) for track in lost]
    assert speeds[-1] < 0.5 * speeds[0]
    back = of(told[-1], 2)
    assert (back.state, back.detection, len(told[-1])) == ("confirmed", 1, 2)


def test_without_the_switch_the_track_ends() -> None:
    assert {track.id for track in crossing(tracker(OcclusionConfig()))[-1]} == {1, 3}


def test_nobody_is_kept_who_stands_in_the_open() -> None:
    sort = tracker(OcclusionConfig(enabled=True))
    for number in range(3):
        sort.update(placed(number, person(2.5, -0.1), person(4, 1, 1, 0.8)))
    for number in range(3, 8):
        tracks = sort.update(placed(number, person(2.5, -0.1)))
    assert [track.id for track in tracks] == [1]
