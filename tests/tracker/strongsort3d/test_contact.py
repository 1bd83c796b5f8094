"""People who touch or cross keep their own tracks."""

import numpy as np
import pytest

from services.tracker.config import (
    ContactConfig,
    OcclusionConfig,
)
from services.tracker.strongsort3d.build import build_strongsort3d
from services.tracker.strongsort3d.contact import beyond_walking, depth_uncertain, pool_ambiguous
from services.tracker.strongsort3d.policies import FrameContext
from services.tracker.strongsort3d.strongsort3d import StrongSort3d
from tests.tracker.scene import frame, person, published, published_config
from tests.tracker.strongsort3d.test_occlusion import BLUE, RED, of, with_pose

ON = ContactConfig(enabled=True)


def tracker(contact: ContactConfig = ON) -> StrongSort3d:
    return build_strongsort3d(published_config(strongsort3d=published(contact=contact)))


def test_pairs_beyond_walking_distance() -> None:
    # Seen 0.1 s ago: 0.4 + 2.5 * 0.1 = 0.65 m; 1 s ago: 2.9 m. Heights do not count.
    config = ContactConfig(jump_m=0.4, speed_max_mps=2.5)
    positions = np.array([[3, 0, 1], [3, 0, 1.0]])
    results = beyond_walking(
        positions, np.array([0.1, 1.0]), [person(3, 0.6), person(3, 2)], config
    )
    assert results.tolist() == [[False, True], [False, False]]


def test_detection_in_line_with_two_tracks_is_overlapping() -> None:
    # Tracks stand at 3 and 4 m in one line of sight; one detection at 3 m, one elsewhere.
    config = published(contact=ON)
    both = np.array([[3, 0, 1], [4, 0, 1.0]])
    detected = with_pose(0, person(3, 0), person(4, 1.2, index=1))
    frame_ = FrameContext(detected, detected.measurements, both, config)
    assert frame_.occluded == {0}
    assert frame_.overlapping == {0}
    assert FrameContext(detected, detected.measurements, both[:1], config).overlapping == set()


def test_distances_of_similar_tracks_are_pooled() -> None:
    # Tracks 0 and 1 look alike (0.05), 2 does not: 0 and 1 share the less of their distances.
    own = np.array([[0, 0.05, 0.6], [0.05, 0, 0.6], [0.6, 0.6, 0]])
    d_cos = np.array([[0.02, 0.08], [0.10, 0.01], [0.5, np.nan]])
    pooled = pool_ambiguous(d_cos, own, 0.1)
    np.testing.assert_array_equal(pooled, [[0.02, 0.01], [0.02, 0.01], [0.5, np.nan]])


def test_covered_detection_gets_covariance_along_the_ray() -> None:
    # The far one's box lies inside the near one's. The line of sight from the origin is (4, 0, 1).
    near, far = person(2, 0), person(4, 0, index=1)
    first, second = depth_uncertain(
        [near, far], with_pose(0, near, far), ContactConfig(depth_sigma_m=2.0)
    )
    assert first.added_covariance_m2 is None
    expected = 4 / 17 * np.outer([4, 0, 1], [4, 0, 1])
    assert second.added_covariance_m2 is not None
    np.testing.assert_allclose(second.added_covariance_m2, expected)


def test_wrong_depth_does_not_pull_a_half_hidden_person() -> None:
    # B stands at 4 m. A steps before B, and for half a second B's depth slides to A's, at 2.5 m.
    # Plain tracks follow; with a doubt of 1 m B stays beyond 3.5 m.
    def run(contact: ContactConfig) -> float:
        strong = published(contact=contact, sigma_measurement_m=0.25)
        sort = build_strongsort3d(published_config(strongsort3d=strong))
        for number in range(20):
            x = 4 - 0.3 * max(number - 14, 0)
            detected = person(4, 0, index=1, score=0.5, embedding=BLUE)
            detected.position_m[:] = [x, 0.0, 1.0]
            before = [person(2.5, 0.1, embedding=RED)] if number >= 12 else []
            tracks = sort.update(with_pose(number, detected, *before))
        return float(of(tracks, 1).position_m[0])

    assert run(ContactConfig(enabled=False)) < 3.2
    assert run(ON) > 3.5


def test_touching_people_of_similar_appearance_do_not_swap() -> None:
    # Both appear the same but for noise opposite to the truth: by appearance a swap costs
    # 0.98 * 2 * 0.005 = 0.0098 less. By position it costs more, but little, since sigma is 0.6 m:
    # S > 0.25 * 1.6 = 0.4, and 0.02 * 2 * (0.4^2 - 0.3^2) / S < 0.007.
    a, b = (1.0, 0.1, 0.0), (1.0, 0.0, 0.0)

    def last(contact: ContactConfig) -> list[int | None]:
        sort = tracker(contact)
        for number in range(10):
            sort.update(frame(number, person(3, 0, 0, 0.9, a), person(3, 0.7, 1, 0.8, b)))
        tracks = sort.update(frame(10, person(3, 0.3, 0, 0.9, b), person(3, 0.4, 1, 0.8, a)))
        return [track.detection for track in tracks]

    assert last(ContactConfig(enabled=False)) == [1, 0]
    assert last(ON) == [0, 1]


def test_occluded_crops_do_not_change_the_embedding() -> None:
    # Boxes at 3 m are 100 px wide; 0.2 m apart they share 60 px. A's picture is a mixture then;
    # A is matched for a second, and apart from B is still RED.
    mixed = (1.0, 0.2, 1.0)
    sort = tracker()
    for number in range(20):
        touching = 5 <= number < 15
        y = 0.2 if touching else 0.6
        embeddings = (mixed, mixed) if touching else (RED, BLUE)
        people = person(3, 0, 0, 0.9, embeddings[0]), person(3, y, 1, 0.8, embeddings[1])
        tracks = sort.update(frame(number, *people))
        if number >= 3 and not touching:
            assert [(t.id, t.detection) for t in tracks if t.state == "confirmed"] == [
                (1, 0),
                (2, 1),
            ]


def test_new_person_of_another_appearance_begins_a_track() -> None:
    def last(contact: ContactConfig) -> list[tuple[int, str]]:
        sort = tracker(contact)
        for number in range(5):
            sort.update(frame(number, person(3, 0, embedding=RED)))
        tracks = sort.update(frame(5, person(3, 0.3, embedding=BLUE)))
        return [(track.id, track.state) for track in tracks]

    assert last(ContactConfig(enabled=False)) == [(1, "confirmed")]
    assert last(ON) == [(1, "lost"), (2, "tentative")]


@pytest.mark.parametrize("hidden", [True, False])
def test_occluded_person_reappears_near_the_occluding_one(hidden: bool) -> None:
    # B, at 4 m, is not found for a second, with A in front. A person of the same appearance
    # comes into view 1.5 m to the left: B would have been detected on the path there. Without the
    # occlusion policy, B may have walked there at 1.4 m/s.
    strong = published(
        contact=ON, occlusion=OcclusionConfig(enabled=hidden), sigma_acceleration_mps2=3.0
    )
    people = build_strongsort3d(published_config(strongsort3d=strong))
    a = person(3, 0, embedding=RED)
    for number in range(4):
        before = people.update(with_pose(number, a, person(4, 0.1, index=1, embedding=BLUE)))
    for number in range(4, 14):
        people.update(with_pose(number, a))
    after = people.update(with_pose(14, a, person(4, 1.6, index=1, embedding=BLUE)))
    b, newcomer = ([t.id for t in tracks if t.detection == 1] for tracks in (before, after))
    assert (newcomer != b) == hidden


def test_first_embeddings_of_a_track_weigh_the_same() -> None:
    # Seen red, then blue: with contact the look is halfway, else 0.9 of the first.
    first, second = np.array([1.0, 0, 0]), np.array([0, 0.6, 0.8])
    for contact, share in ((ON, 0.5), (ContactConfig(enabled=False), 0.9)):
        config = published(contact=contact, n_init=1, cosine_distance_max={"histogram": 1.5})
        people = build_strongsort3d(published_config(strongsort3d=config))
        people.update(with_pose(0, person(3, 0, embedding=tuple(first))))
        people.update(with_pose(1, person(3, 0, embedding=tuple(second))))
        (record,) = people.tracks.records
        assert record.embedding is not None
        mixed = share * first + (1 - share) * second
        np.testing.assert_allclose(record.embedding, mixed / np.linalg.norm(mixed))
