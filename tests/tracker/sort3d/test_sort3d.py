"""The life of SORT-3D's tracks, frame by frame (docs/method.md section 4)."""

import msgspec

from people4d.messages import Track
from services.tracker.config import Sort3dConfig
from services.tracker.sort3d.sort3d import Sort3d
from tests.tracker.scene import FRAME_NS, frame, person, published_config


def tracker(**fields: float) -> Sort3d:
    return Sort3d(published_config(sort3d=msgspec.convert(fields, Sort3dConfig)))


def states(tracks: list[Track]) -> list[tuple[int, str]]:
    return [(track.id, track.state) for track in tracks]


def test_long_absence_of_frames_counts_as_one_second() -> None:
    sort = tracker()
    sort.update(frame(0, person(3, 0)))
    assert sort.tracks.bridge_absence(40 * FRAME_NS) == 0  # 4 s: less than max_lost_s
    assert sort.tracks.bridge_absence(200 * FRAME_NS) == 190 * FRAME_NS
    (track,) = sort.update(frame(200))
    assert track.time_since_update_s == 1.0


def test_t_lost_unmatched_frames_delete() -> None:
    sort = tracker(t_lost=2)
    for number in range(3):
        sort.update(frame(number, person(3, 0)))
    assert states(sort.update(frame(3))) == [(1, "lost")]
    assert sort.update(frame(4)) == []
    assert states(sort.update(frame(5, person(3, 0)))) == [(2, "tentative")]


def test_plain_sort_deletes_at_the_second_miss() -> None:
    sort = tracker(t_lost=1)
    for number in range(3):
        sort.update(frame(number, person(3, 0)))
    assert sort.update(frame(3)) == []


def test_a_tentative_track_needs_its_matches_in_a_row() -> None:
    sort = tracker()
    detected = [True, True, False, True, True, True]
    results = []
    for number, here in enumerate(detected):
        results += states(sort.update(frame(number, *[person(3, 0)] * here)))
    assert results == [(1, "tentative")] * 5 + [(1, "confirmed")]


def test_boxes_that_overlap_too_little_are_two_people() -> None:
    # At 3 m the box is 100 px wide; 0.4 m aside it moves by 80 px: IoU = 20 / 180 = 0.11 < 0.3.
    steps = frame(0, person(3, 0)), frame(1, person(3, 0.4))
    sort = tracker()
    sort.update(steps[0])
    assert [track.id for track in sort.update(steps[1])] == [1, 2]


def test_distance_gate_follows_the_previous_frame() -> None:
    # Frame 1: one pair, d = 0.05: tau = 0.05. Frame 2: the same box, but 0.3 m behind.
    def third_frame(**fields: float) -> list[int]:
        sort = tracker(**fields)
        sort.update(frame(0, person(3, 0)))
        sort.update(frame(1, person(3, 0.05)))
        return [track.id for track in sort.update(frame(2, person(3.35, 0.05)))]

    assert third_frame(distance_gate_floor_m=0.0) == [1, 2]
    assert third_frame(distance_gate_floor_m=0.5) == [1]


def test_plain_distance_gate_loses_a_lone_person_and_the_floor_keeps_them() -> None:
    # With one pair sigma = 0: tau is the last distance, so any larger one is refused.
    wobble = [0.0, 0.0, 0.01, 0.03, 0.0, 0.05, 0.01, 0.08]

    def identities(floor_m: float) -> set[int]:
        sort = tracker(distance_gate_floor_m=floor_m)
        return {
            track.id
            for number, y in enumerate(wobble)
            for track in sort.update(frame(number, person(3, y)))
        }

    assert len(identities(0.0)) > 1
    assert identities(0.5) == {1}


def test_two_people_side_by_side_keep_their_identities() -> None:
    sort = tracker()
    for number in range(10):
        y = 0.05 * number
        tracks = sort.update(frame(number, person(3, -1 + y, 0), person(3, 1 - y, 1)))
    assert [(track.id, track.state) for track in tracks] == [(1, "confirmed"), (2, "confirmed")]
    assert tracks[0].position_m[1] * tracks[1].position_m[1] < 0
