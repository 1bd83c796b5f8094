"""Occluded people keep their tracks."""

import itertools

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, invert
from people4d.messages import Track
from services.tracker.strongsort3d.build import build_strongsort3d
from services.tracker.strongsort3d.policies import FrameContext
from services.tracker.strongsort3d.strongsort3d import StrongSort3d
from services.tracker.strongsort3d.visibility import covered_m2, occluded
from tests.tracker.scene import BLUE, RED, person, published, published_config, with_pose

OPTICAL_FROM_LINK = invert(LINK_FROM_OPTICAL)


def tracker(visibility: bool = True, a_max: int = 5) -> StrongSort3d:
    strong = published(visibility=visibility, a_max=a_max)
    return build_strongsort3d(published_config(strongsort3d=strong))


def of(tracks: list[Track], number: int) -> Track:
    return next(track for track in tracks if track.id == number)


def test_people_behind_detected_ones_are_occluded() -> None:
    # Intervals with a half width of 0.25 m: A at 2 m covers -0.125 to 0.125. B at 4 m, 0.1 m to the
    # left, is -0.0875 to 0.0375, all covered. C at 4 m, 0.6 m to the right, is 0.0875 to 0.2125;
    # its covered share is 0.0375 / 0.125 = 0.3, less than 0.4. D at 1.5 m is in front of A.
    detected, people = np.array([[2, 0, 1.0]]), np.array([[4, 0.1, 1], [4, -0.6, 1], [1.5, 0, 1]])
    assert occluded(people, detected, OPTICAL_FROM_LINK).tolist() == [True, False, False]
    assert occluded(people, detected, None).tolist() == [False, False, False]


def test_person_detected_for_the_first_time_occludes_others() -> None:
    # A stands at 4 m; new person B occludes A for one frame. One miss would end A.
    sort = tracker(a_max=1)
    for number in range(5):
        sort.update(with_pose(number, person(4, 0, embedding=RED)))
    tracks = sort.update(with_pose(5, person(2, 0, embedding=BLUE)))
    assert [(track.id, track.state) for track in tracks] == [(1, "lost"), (2, "tentative")]


@pytest.mark.parametrize("embedding", [RED, (0.0, 1.0, 0.0)])
def test_occluded_person_who_comes_out_beside_the_prediction_goes_on(
    embedding: tuple[float, ...],
) -> None:
    # 0.6 m from the prediction: beyond the gate of motion, within the distance of round 2.
    strong = published(visibility=True, sigma_measurement_m=0.02, sigma_acceleration_mps2=1.0)
    sort = build_strongsort3d(published_config(strongsort3d=strong))
    for number in range(8):
        sort.update(with_pose(number, person(4, 0, embedding=RED)))
    before = person(2, 0, 1, embedding=BLUE)
    sort.update(with_pose(8, before))
    tracks = sort.update(with_pose(9, before, person(4, 0.6, embedding=embedding)))
    assert of(tracks, 1).detection == 0


def test_track_of_few_matches_ends_behind_others() -> None:
    # A track of 2 matches survives 3 occluded frames, not 4.
    strong = published(visibility=True, n_init=2, lifetime="hits")
    sort = build_strongsort3d(published_config(strongsort3d=strong))
    before = person(2, 0)
    for number in range(10):
        behind = [person(4, 0, 1)] if 2 <= number < 4 else []
        tracks = sort.update(with_pose(number, before, *behind))
        assert len(tracks) == (2 if 2 <= number < 7 else 1)


def crossing(sort: StrongSort3d) -> list[list[Track]]:
    """B walks behind the standing A, occluded for 1 s, from frame 13 to 22."""
    result = []
    for number in range(30):
        y = -1.2 + 0.06 * number
        people = [person(2.5, -0.1, embedding=RED)]
        if not 13 <= number < 23:
            people.append(person(4, y, index=1, embedding=BLUE))
        result.append(sort.update(with_pose(number, *people)))
    return result


def test_person_occluded_for_a_second_keeps_the_track() -> None:
    result = crossing(tracker())
    lost = [of(tracks, 2) for tracks in result[13:23]]
    assert all(track.state == "lost" and track.detection is None for track in lost)
    sizes = [float(np.trace(track.covariance[:2, :2])) for track in lost]
    assert all(later > earlier for earlier, later in itertools.pairwise(sizes))
    speeds = [float(np.linalg.norm(track.velocity_mps)) for track in lost]
    assert speeds[-1] < 0.5 * speeds[0]
    back = of(result[-1], 2)
    assert (back.state, back.detection, len(result[-1])) == ("confirmed", 1, 2)


def test_occluded_track_ends_without_the_policy() -> None:
    assert {track.id for track in crossing(tracker(visibility=False))[-1]} == {1, 3}


def test_unoccluded_track_ends_after_a_max_frames() -> None:
    sort = tracker()
    for number in range(3):
        sort.update(with_pose(number, person(2.5, -0.1), person(4, 1, 1, 0.8)))
    for number in range(3, 8):
        tracks = sort.update(with_pose(number, person(2.5, -0.1)))
    assert [track.id for track in tracks] == [1]


def test_covered_detection_gets_covariance_along_the_ray() -> None:
    # The far one's box lies inside the near one's. The line of sight from the origin is (4, 0, 1).
    near, far = person(2, 0), person(4, 0, index=1)
    context = FrameContext(with_pose(0, near, far), [near, far], published())
    added_m2 = covered_m2(context)
    assert added_m2 is not None
    np.testing.assert_array_equal(added_m2[0], np.zeros((3, 3)))
    np.testing.assert_allclose(added_m2[1], 1 / 17 * np.outer([4, 0, 1], [4, 0, 1]))
    alone = FrameContext(with_pose(0, near), [near], published())
    assert covered_m2(alone) is None


def test_match_of_a_half_hidden_person_counts_in_full() -> None:
    # B stands at 4 m, A steps before B. B walks on to 2.5 m, covered all the time: the track stays
    # with its measurement, as without the policy, although gates are wide.
    def run(visibility: bool) -> float:
        strong = published(visibility=visibility, sigma_measurement_m=0.25)
        sort = build_strongsort3d(published_config(strongsort3d=strong))
        for number in range(20):
            x = 4 - 0.1 * max(number - 14, 0)
            detected = person(4, 0, index=1, score=0.5, embedding=BLUE)
            detected.position_m[:] = [x, 0.0, 1.0]
            before = [person(2.5, 0.1, embedding=RED)] if number >= 12 else []
            tracks = sort.update(with_pose(number, detected, *before))
        return float(of(tracks, 1).position_m[0])

    assert run(visibility=True) == pytest.approx(run(visibility=False))


def test_covered_person_with_the_depth_of_another_keeps_the_track() -> None:
    # B, at 4 m, is measured 1.2 m nearer once A covers B. This is beyond the gate of section 5, and
    # within the gate of a covered detection, which requires a known cosine distance.
    def last(visibility: bool, blue: tuple[float, ...] | None) -> list[tuple[int, str]]:
        strong = published(visibility=visibility, sigma_measurement_m=0.2)
        sort = build_strongsort3d(published_config(strongsort3d=strong))
        for number in range(10):
            detected = person(4, 0, index=1, score=0.5, embedding=blue)
            sort.update(with_pose(number, person(2.5, 0.1, embedding=RED), detected))
        detected.position_m[:] = [2.8, 0.0, 1.0]
        tracks = sort.update(with_pose(10, person(2.5, 0.1, embedding=RED), detected))
        return [(track.id, track.state) for track in tracks]

    without = [(1, "confirmed"), (2, "lost"), (3, "tentative")]
    assert last(False, BLUE) == without
    assert last(True, None) == without
    assert last(True, BLUE) == [(1, "confirmed"), (2, "confirmed")]
