"""People hidden behind others keep their tracks."""

import dataclasses
import itertools

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, invert
from people4d.messages import Track
from services.tracker.interface import Measurement, Observation
from services.tracker.strongsort3d.build import build_strongsort3d
from services.tracker.strongsort3d.config import OcclusionConfig
from services.tracker.strongsort3d.occlusion import occluded
from services.tracker.strongsort3d.strongsort3d import StrongSort3d
from tests.tracker.scene import frame, person, published, published_config

OPTICAL_FROM_LINK = invert(LINK_FROM_OPTICAL)
RED, BLUE = (1.0, 0.1, 0.0), (0.0, 0.1, 1.0)


def with_pose(number: int, *people: Measurement) -> Observation:
    """A frame of a camera at the origin of the map that looks along +x."""
    observation = frame(number, *people)
    return dataclasses.replace(observation, map_from_camera=LINK_FROM_OPTICAL, size_px=(640, 480))


def tracker(occlusion: OcclusionConfig, a_max: int = 5) -> StrongSort3d:
    strong = published(occlusion=occlusion, a_max=a_max)
    return build_strongsort3d(published_config(strongsort3d=strong))


def of(tracks: list[Track], number: int) -> Track:
    return next(track for track in tracks if track.id == number)


def test_people_behind_detected_ones_are_occluded() -> None:
    # Strips, half a width of 0.25 m: A at 2 m covers -0.125 to 0.125; B at 4 m and 0.1 m to the
    # left is -0.0875 to 0.0375, all of it covered; C at 4 m, 0.6 m to the right, is 0.0875 to
    # 0.2125, of which 0.0375 / 0.125 = 0.3 are covered; D at 1.5 m is before A.
    detected, people = np.array([[2, 0, 1.0]]), np.array([[4, 0.1, 1], [4, -0.6, 1], [1.5, 0, 1]])
    result = occluded(people, detected, OPTICAL_FROM_LINK, OcclusionConfig(covered_min=0.4))
    assert result.tolist() == [True, False, False]
    result = occluded(people, detected, OPTICAL_FROM_LINK, OcclusionConfig(covered_min=0.29))
    assert result.tolist() == [True, True, False]


def test_person_detected_for_the_first_time_occludes_others() -> None:
    # A stands at 4 m; B comes for the first time, before A for a frame. One miss would end A.
    sort = tracker(OcclusionConfig(enabled=True), a_max=1)
    for number in range(5):
        sort.update(with_pose(number, person(4, 0, embedding=RED)))
    tracks = sort.update(with_pose(5, person(2, 0, embedding=BLUE)))
    assert [(track.id, track.state) for track in tracks] == [(1, "lost"), (2, "tentative")]


@pytest.mark.parametrize("embedding", [RED, (0.0, 1.0, 0.0)])
def test_occluded_person_who_comes_out_beside_the_prediction_goes_on(
    embedding: tuple[float, ...],
) -> None:
    # 0.6 m from the prediction: beyond the gate of motion, within the distance of round 2.
    strong = published(
        occlusion=OcclusionConfig(enabled=True),
        sigma_measurement_m=0.02,
        sigma_acceleration_mps2=1.0,
    )
    sort = build_strongsort3d(published_config(strongsort3d=strong))
    for number in range(8):
        sort.update(with_pose(number, person(4, 0, embedding=RED)))
    before = person(2, 0, 1, embedding=BLUE)
    sort.update(with_pose(8, before))
    tracks = sort.update(with_pose(9, before, person(4, 0.6, embedding=embedding)))
    assert of(tracks, 1).detection == 0


def test_track_of_few_matches_ends_behind_others() -> None:
    # Found in 2 frames, it outlives 3 frames behind the other person, not 4.
    strong = published(occlusion=OcclusionConfig(enabled=True), n_init=2, lifetime="hits")
    sort = build_strongsort3d(published_config(strongsort3d=strong))
    before = person(2, 0)
    for number in range(10):
        behind = [person(4, 0, 1)] if 2 <= number < 4 else []
        tracks = sort.update(with_pose(number, before, *behind))
        assert len(tracks) == (2 if 2 <= number < 7 else 1)


def crossing(sort: StrongSort3d) -> list[list[Track]]:
    """B walks behind A, who stands, and is not seen for 1 s, from frame 13 to 22."""
    result = []
    for number in range(30):
        y = -1.2 + 0.06 * number
        people = [person(2.5, -0.1, embedding=RED)]
        if not 13 <= number < 23:
            people.append(person(4, y, index=1, embedding=BLUE))
        result.append(sort.update(with_pose(number, *people)))
    return result


def test_person_occluded_for_a_second_keeps_the_track() -> None:
    result = crossing(tracker(OcclusionConfig(enabled=True)))
    lost = [of(tracks, 2) for tracks in result[13:23]]
    assert all(track.state == "lost" and track.detection is None for track in lost)
    sizes = [float(np.trace(track.covariance[:2, :2])) for track in lost]
    assert all(later > earlier for earlier, later in itertools.pairwise(sizes))
    speeds = [float(np.linalg.norm(track.velocity_mps)) for track in lost]
    assert speeds[-1] < 0.5 * speeds[0]
    back = of(result[-1], 2)
    assert (back.state, back.detection, len(result[-1])) == ("confirmed", 1, 2)


def test_occluded_track_ends_without_the_policy() -> None:
    assert {track.id for track in crossing(tracker(OcclusionConfig(enabled=False)))[-1]} == {1, 3}


def test_unoccluded_track_ends_after_a_max_frames() -> None:
    sort = tracker(OcclusionConfig(enabled=True))
    for number in range(3):
        sort.update(with_pose(number, person(2.5, -0.1), person(4, 1, 1, 0.8)))
    for number in range(3, 8):
        tracks = sort.update(with_pose(number, person(2.5, -0.1)))
    assert [track.id for track in tracks] == [1]
