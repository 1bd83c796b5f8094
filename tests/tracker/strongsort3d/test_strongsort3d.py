"""The life of StrongSORT-3D's tracks, frame by frame (docs/method.md, section 5)."""

import dataclasses
import math
from typing import Any, Literal

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, transform_from
from people4d.messages import Track
from services.tracker.interface import Observation
from services.tracker.strongsort3d.build import build_strongsort3d
from services.tracker.strongsort3d.strongsort3d import StrongSort3d
from tests.tracker.scene import BLUE, RED, frame, person, published, published_config


def tracker(**fields: Any) -> StrongSort3d:
    return build_strongsort3d(published_config(strongsort3d=published(**fields)))


def observed(observation: Observation) -> Observation:
    """The frame of a camera at the origin of the map that looks along +x."""
    return dataclasses.replace(
        observation, map_from_camera=transform_from([0.0, 0.0, 0.0], LINK_FROM_OPTICAL[:3, :3])
    )


def states(tracks: list[Track]) -> list[tuple[int, str]]:
    return [(track.id, track.state) for track in tracks]


def test_tentative_track_is_deleted_after_one_miss() -> None:
    sort = tracker()
    sort.update(frame(0, person(3, 0)))
    assert sort.update(frame(1)) == []
    assert states(sort.update(frame(2, person(3, 0)))) == [(2, "tentative")]


def test_a_max_unmatched_frames_delete() -> None:
    sort = tracker(a_max=3)
    for number in range(3):
        sort.update(frame(number, person(3, 0)))
    assert states(sort.update(frame(3))) == [(1, "lost")]
    assert states(sort.update(frame(4))) == [(1, "lost")]
    assert sort.update(frame(5)) == []


def test_by_hits_matches_need_not_be_in_a_row() -> None:
    # Match, match, miss, match: "hits" confirms at the third match; "streak" starts a new track.
    def last(lifetime: Literal["streak", "hits"]) -> list[tuple[int, str]]:
        sort = tracker(lifetime=lifetime)
        for number in (0, 1):
            sort.update(frame(number, person(3, 0)))
        sort.update(frame(2))
        return states(sort.update(frame(3, person(3, 0))))

    assert last("hits") == [(1, "confirmed")]
    assert last("streak") == [(2, "tentative")]


def test_by_hits_a_track_ends_after_as_many_misses_as_matches() -> None:
    # Two matches confirm, then two misses end; of ten matches a_max counts.
    for matches, survives in ((2, 1), (10, 4)):
        sort = tracker(lifetime="hits", n_init=2, a_max=5)
        for number in range(matches):
            sort.update(frame(number, person(3, 0)))
        results = [sort.update(frame(matches + k)) for k in range(survives + 1)]
        assert [states(tracks) for tracks in results] == [[(1, "lost")]] * survives + [[]]


@pytest.mark.parametrize(("matches", "survives"), [(1, 1), (2, 3), (4, 15)])
def test_by_hits_a_track_behind_others_ends_after_the_square_of_its_matches(
    matches: int, survives: int
) -> None:
    sort = tracker(lifetime="hits", n_init=1, a_max=5, visibility=True)
    before = person(2, 0, index=1)
    for number in range(matches):
        sort.update(observed(frame(number, person(4, 0))))
    lost = [sort.update(observed(frame(matches + k, before)))[0].id == 1 for k in range(40)]
    assert lost == [True] * survives + [False] * (40 - survives)


def test_by_hits_an_image_of_something_else_is_not_confirmed() -> None:
    # Mean log-odds of four matches: -3; of five, one of them unknown: -12 / 5 = -2.4.
    sort = tracker(lifetime="hits", n_init=2)
    poster = dataclasses.replace(person(3, 0), person_log_odds=-3.0)
    for number in range(4):
        assert states(sort.update(frame(number, poster))) == [(1, "tentative")]
    assert states(sort.update(frame(4, person(3, 0)))) == [(1, "confirmed")]
    assert states(sort.update(frame(5, poster))) == [(1, "confirmed")]  # not taken back


def test_by_streak_images_do_not_count() -> None:
    sort = tracker(n_init=2)
    poster = dataclasses.replace(person(3, 0), person_log_odds=-6.0)
    sort.update(frame(0, poster))
    assert states(sort.update(frame(1, poster))) == [(1, "confirmed")]


def test_while_several_cameras_send_a_third_match_confirms() -> None:
    # Two matches by one of several cameras may be a false alarm.
    sort = tracker(lifetime="hits", n_init=2)
    for number in range(0, 4, 2):
        sort.update(frame(number, person(3, 0)))
        (track,) = sort.update(frame(number + 1, camera="other"))
        assert track.state == "tentative"
    assert states(sort.update(frame(4, person(3, 0)))) == [(1, "confirmed")]
    alone = tracker(lifetime="hits", n_init=2)
    alone.update(frame(0, person(3, 0)))
    assert states(alone.update(frame(1, person(3, 0)))) == [(1, "confirmed")]


def test_while_several_cameras_send_a_tentative_track_ends_after_a_second() -> None:
    # An occluded camera never misses the track.
    def lasts(*cameras: str) -> int:
        sort = tracker(lifetime="hits", n_init=2)
        sort.update(frame(0, person(3, 0)))
        results = [sort.update(frame(k, camera=cameras[k % len(cameras)])) for k in range(1, 60)]
        return sum(bool(tracks) for tracks in results)

    assert lasts("b", "c") == 10
    assert lasts("camera") == 0


def test_first_two_frames_on_paper() -> None:
    # x = 2.5 m, score 0.8: R = 0.25 * 1.5 * 0.2 = 0.075 per axis; P0 = diag(0.075, 4), v = 0.
    # dt = 0.1: P = [[0.075 + 0.01 * 4 + 6.25e-6, 0.4 + 1.25e-4], [., 4 + 2.5e-3]],
    # S = 0.11500625 + 0.075 = 0.19000625, K = [0.60527614, 2.10585178] (0.400125 / S).
    # z moved by 0.1 in y: y = 0.060527614, v_y = 0.210585178; P_yy = (1 - K) 0.11500625.
    sort = tracker()
    sort.update(frame(0, person(2.5, 0, score=0.8)))
    (track,) = sort.update(frame(1, person(2.5, 0.1, score=0.8)))
    np.testing.assert_allclose(track.position_m, [2.5, 0.060527614, 1.0], atol=1e-7)
    np.testing.assert_allclose(track.velocity_mps, [0, 0.210585178, 0], atol=1e-7)
    assert track.covariance[1, 1] == pytest.approx(0.0453957, abs=1e-6)
    assert track.yaw_rad == pytest.approx(math.pi / 2)


def test_a_slow_person_has_no_heading() -> None:
    sort = tracker()
    for number in range(5):
        (track,) = sort.update(frame(number, person(3, 0)))
    assert track.yaw_rad is None


def test_round_two_accepts_a_sudden_change_of_appearance() -> None:
    sort = tracker()
    for number in range(3):
        sort.update(frame(number, person(3, 0, embedding=RED)))
    assert states(sort.update(frame(3, person(3, 0, embedding=BLUE)))) == [(1, "confirmed")]


def test_round_two_is_closed_to_tracks_missed_before() -> None:
    sort = tracker()
    for number in range(3):
        sort.update(frame(number, person(3, 0, embedding=RED)))
    sort.update(frame(3))
    results = states(sort.update(frame(4, person(3, 0, embedding=BLUE))))
    assert results == [(1, "lost"), (2, "tentative")]
    results = states(sort.update(frame(5, person(3, 0, embedding=RED))))
    assert results == [(1, "confirmed")]  # and the unmatched tentative track is deleted


def test_round_two_has_a_largest_distance() -> None:
    # A tentative track goes through round 2 only: 0.69 m aside matches, 0.71 m does not.
    for y, identity in ((0.69, 1), (0.71, 2)):
        sort = tracker()
        sort.update(frame(0, person(3, 0)))
        assert [track.id for track in sort.update(frame(1, person(3, y)))] == [identity]


def test_embeddings_of_another_model_are_dropped() -> None:
    sort = tracker()
    for number in range(3):
        sort.update(frame(number, person(3, 0, embedding=RED)))
    sort.update(frame(3))  # round 2 is closed now: only round 1 can match
    late = frame(4, person(3, 0, embedding=(0.0, 0.0, 0.0, 1.0)))
    assert states(sort.update(late)) == [(1, "confirmed")]


@pytest.mark.parametrize("detected", [True, False])
def test_people_who_meet_and_turn_back_need_appearance(detected: bool) -> None:
    # Two people approach, meet at y = 0 and turn back: motion alone suggests that they pass.
    sort = tracker()
    for number in range(60):
        y = abs(1.5 - 0.05 * number)
        red = person(3, y + 0.02, 0, embedding=RED if detected else None)
        blue = person(3, -y - 0.02, 1, embedding=BLUE if detected else None)
        tracks = sort.update(frame(number, red, blue))
        if number == 3:
            start = {track.detection: track.id for track in tracks}
    end = {track.detection: track.id for track in tracks if track.state == "confirmed"}
    assert (start == end) is detected


def test_crossing_people_keep_their_identities() -> None:
    sort = tracker()
    results = []
    for number in range(60):
        y = 1.5 - 0.05 * number
        red, blue = person(3, y, 0, embedding=RED), person(3.1, -y, 1, embedding=BLUE)
        results.append({t.detection: t.id for t in sort.update(frame(number, red, blue))})
    assert all(ids == results[0] for ids in results)


def test_empty_frame_of_another_camera_ends_no_track() -> None:
    sort = tracker()
    for number in range(6):
        sort.update(frame(2 * number, person(3, 0), camera="front"))
        tracks = sort.update(frame(2 * number + 1, camera="back"))
    assert states(tracks) == [(1, "lost")]
    assert tracks[0].hits == 6
    (handed_over,) = sort.update(frame(12, person(3, 0), camera="back"))
    assert (handed_over.id, handed_over.state) == (1, "confirmed")
