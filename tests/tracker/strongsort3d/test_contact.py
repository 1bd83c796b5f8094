"""People who touch or cross keep their own tracks."""

import numpy as np
import pytest

from services.tracker.config import StrongSort3dConfig, TrackerConfig
from services.tracker.identity.config import ContactConfig, OcclusionConfig
from services.tracker.strongsort3d.contact import (
    covered_shares,
    crowded,
    doubted,
    indistinct,
    out_of_reach,
    scene,
    unclear,
)
from services.tracker.strongsort3d.strongsort3d import StrongSort3d
from tests.tracker.scene import frame, person
from tests.tracker.strongsort3d.test_occlusion import BLUE, RED, of, placed

ON = ContactConfig(enabled=True)


def tracker(contact: ContactConfig = ON) -> StrongSort3d:
    return StrongSort3d(TrackerConfig(strongsort3d=StrongSort3dConfig(contact=contact)))


def test_covered_shares() -> None:
    # 10x10 and 5x10 share 3x10: 0.3 of the first and 0.6 of the second; the third is alone.
    boxes = np.array([[0, 0, 10, 10], [7, 0, 12, 10], [50, 0, 60, 10.0]])
    np.testing.assert_allclose(covered_shares(boxes), [0.3, 0.6, 0.0])
    # 1 % of 100 px: whoever is nearer to the side of the image than 1 px may be cut off.
    assert unclear(boxes, None, 0.4).tolist() == [False, True, False]
    assert unclear(boxes, (100, 10), 0.4).tolist() == [True, True, False]


def test_out_of_reach() -> None:
    # Seen 0.1 s ago: 0.4 + 2.5 * 0.1 = 0.65 m; 1 s ago: 2.9 m. Heights do not count.
    config = ContactConfig(jump_m=0.4, speed_max_mps=2.5)
    places = np.array([[3, 0, 1], [3, 0, 1.0]])
    told = out_of_reach(places, np.array([0.1, 1.0]), [person(3, 0.6), person(3, 2)], config)
    assert told.tolist() == [[False, True], [False, False]]


def test_crowded() -> None:
    # The first detection covers half of track 0 and all of track 1, the second half of track 1.
    found = np.array([[0, 0.2], [0.15, 0.35]])
    tracks = np.array([[-0.1, 0.1], [0.1, 0.2]])
    assert crowded(found, tracks, 0.5).tolist() == [True, False]
    assert crowded(found, tracks, 0.51).tolist() == [False, False]
    assert crowded(found, tracks[:0], 0.5).tolist() == [False, False]


def test_one_picture_of_two_people_shows_neither_clearly() -> None:
    # Tracks stand at 3 and 4 m in one line of sight; one detection at 3 m, one elsewhere.
    config = StrongSort3dConfig(contact=ON)
    both = np.array([[3, 0, 1], [4, 0, 1.0]])
    seen = placed(0, person(3, 0), person(4, 1.2, index=1))
    assert scene(seen, both, config).unclear == {0}
    assert scene(seen, both, config).crowded == {0}
    assert scene(seen, both[:1], config).crowded == set()
    assert scene(seen, both, StrongSort3dConfig()).unclear == set()


def test_only_positions_tell_people_who_look_alike_apart() -> None:
    # Tracks 0 and 1 look alike (0.05), 2 does not: 0 and 1 share the less of their distances.
    looks = np.array([[0, 0.05, 0.6], [0.05, 0, 0.6], [0.6, 0.6, 0]])
    d_cos = np.array([[0.02, 0.08], [0.10, 0.01], [0.5, np.nan]])
    shared = indistinct(d_cos, looks, 0.1)
    np.testing.assert_array_equal(shared, [[0.02, 0.01], [0.02, 0.01], [0.5, np.nan]])


def test_depth_of_who_is_half_hidden_is_doubted() -> None:
    # The far one's box lies inside the near one's. The line of sight from the origin is (4, 0, 1).
    near, far = person(2, 0), person(4, 0, index=1)
    first, second = doubted([near, far], placed(0, near, far), ContactConfig(doubt_sigma_m=2.0))
    assert first.doubt_m2 is None
    expected = 4 / 17 * np.outer([4, 0, 1], [4, 0, 1])
    assert second.doubt_m2 is not None
    np.testing.assert_allclose(second.doubt_m2, expected)


def test_a_wrong_depth_does_not_pull_a_half_hidden_person() -> None:
    # B stands at 4 m. A steps before B, and for half a second B's depth slides to A's, at 2.5 m.
    # Plain tracks follow; with a doubt of 1 m B stays beyond 3.5 m.
    def run(contact: ContactConfig) -> float:
        strong = StrongSort3dConfig(contact=contact, sigma_measurement_m=0.25)
        sort = StrongSort3d(TrackerConfig(strongsort3d=strong))
        for number in range(20):
            x = 4 - 0.3 * max(number - 14, 0)
            seen = person(4, 0, index=1, score=0.5, embedding=BLUE)
            seen.position_m[:] = [x, 0.0, 1.0]
            before = [person(2.5, 0.1, embedding=RED)] if number >= 12 else []
            tracks = sort.update(placed(number, seen, *before))
        return float(of(tracks, 1).position_m[0])

    assert run(ContactConfig()) < 3.2
    assert run(ON) > 3.5


def test_touching_people_dressed_alike_do_not_swap() -> None:
    # Both look the same but for noise that says the opposite of the truth: by looks a swap costs
    # 0.98 * 2 * 0.005 = 0.0098 less. By position it costs more, but little, since sigma is 0.6 m:
    # S > 0.25 * 1.6 = 0.4, and 0.02 * 2 * (0.4^2 - 0.3^2) / S < 0.007.
    a, b = (1.0, 0.1, 0.0), (1.0, 0.0, 0.0)

    def last(contact: ContactConfig) -> list[int | None]:
        sort = tracker(contact)
        for number in range(10):
            sort.update(frame(number, person(3, 0, 0, 0.9, a), person(3, 0.7, 1, 0.8, b)))
        tracks = sort.update(frame(10, person(3, 0.3, 0, 0.9, b), person(3, 0.4, 1, 0.8, a)))
        return [track.detection for track in tracks]

    assert last(ContactConfig()) == [1, 0]
    assert last(ON) == [0, 1]


def test_pictures_of_two_do_not_change_what_a_track_looks_like() -> None:
    # Boxes at 3 m are 100 px wide; 0.2 m apart they share 60 px. A's picture is a mixture then;
    # A is matched for a second, and parted from B still looks RED.
    mixed = (1.0, 0.2, 1.0)
    sort = tracker()
    for number in range(20):
        touching = 5 <= number < 15
        y = 0.2 if touching else 0.6
        looks = (mixed, mixed) if touching else (RED, BLUE)
        people = person(3, 0, 0, 0.9, looks[0]), person(3, y, 1, 0.8, looks[1])
        tracks = sort.update(frame(number, *people))
        if number >= 3 and not touching:
            assert [(t.id, t.detection) for t in tracks if t.state == "confirmed"] == [
                (1, 0),
                (2, 1),
            ]


def test_a_newcomer_does_not_get_the_track_of_who_was_there_a_moment_ago() -> None:
    def last(contact: ContactConfig) -> list[tuple[int, str]]:
        sort = tracker(contact)
        for number in range(5):
            sort.update(frame(number, person(3, 0, embedding=RED)))
        tracks = sort.update(frame(5, person(3, 0.3, embedding=BLUE)))
        return [(track.id, track.state) for track in tracks]

    assert last(ContactConfig()) == [(1, "confirmed")]
    assert last(ON) == [(1, "lost"), (2, "tentative")]


@pytest.mark.parametrize("hidden", [True, False])
def test_who_is_hidden_comes_out_behind_whoever_hides_them(hidden: bool) -> None:
    # B, at 4 m, is not found for a second, with A before them. Somebody who looks the same comes
    # into view 1.5 m to the left: they would have been seen on the way there. If it is not asked
    # who is hidden, B may have walked there unnoticed, at 1.4 m/s.
    strong = StrongSort3dConfig(
        contact=ON, occlusion=OcclusionConfig(enabled=hidden), sigma_acceleration_mps2=3.0
    )
    people = StrongSort3d(TrackerConfig(strongsort3d=strong))
    a = person(3, 0, embedding=RED)
    for number in range(4):
        before = people.update(placed(number, a, person(4, 0.1, index=1, embedding=BLUE)))
    for number in range(4, 14):
        people.update(placed(number, a))
    after = people.update(placed(14, a, person(4, 1.6, index=1, embedding=BLUE)))
    b, newcomer = ([t.id for t in tracks if t.detection == 1] for tracks in (before, after))
    assert (newcomer != b) == hidden


def test_the_first_pictures_of_a_track_count_alike() -> None:
    # Seen red, then blue: with contact the look is halfway, else 0.9 of the first.
    first, second = np.array([1.0, 0, 0]), np.array([0, 0.6, 0.8])
    for contact, share in ((ON, 0.5), (ContactConfig(), 0.9)):
        config = StrongSort3dConfig(
            contact=contact, n_init=1, cosine_distance_max={"histogram": 1.5}
        )
        people = StrongSort3d(TrackerConfig(strongsort3d=config))
        people.update(placed(0, person(3, 0, embedding=tuple(first))))
        people.update(placed(1, person(3, 0, embedding=tuple(second))))
        (target,) = people._people.targets
        assert target.embedding is not None
        mixed = share * first + (1 - share) * second
        np.testing.assert_allclose(target.embedding, mixed / np.linalg.norm(mixed))
