"""Re-identification of returning people."""

import dataclasses

import numpy as np
import pytest

from people4d.messages import Track
from services.tracker.interface import Measurement
from services.tracker.strongsort3d.build import build_strongsort3d
from services.tracker.strongsort3d.config import IdentityConfig
from services.tracker.strongsort3d.identity import identity_posterior, reason_of
from services.tracker.strongsort3d.strongsort3d import StrongSort3d
from tests.tracker.scene import (
    BLUE,
    RED,
    frame,
    person,
    published,
    published_config,
    unit,
    with_pose,
)

RED_TOO = (1.0, 0.12, 0.0)  # 0.0002 from RED
ALL = published(visibility=True, identity=IdentityConfig(enabled=True))


def tracker(identity: IdentityConfig | None = None) -> StrongSort3d:
    strong = published(identity=identity or IdentityConfig(enabled=True), a_max=5)
    return build_strongsort3d(published_config(strongsort3d=strong))


def stay(
    sort: StrongSort3d, first: int, count: int, *people: Measurement
) -> list[tuple[int, str, str | None]]:
    """Add frames of standing people; return the last tracks that are not tentative."""
    tracks: list[Track] = []
    for number in range(first, first + count):
        tracks = sort.update(frame(number, *people))
    return [(t.id, t.state, t.identity) for t in tracks if t.state != "tentative"]


def test_leave_and_return() -> None:
    sort = tracker()
    assert stay(sort, 0, 3, person(3, 0, embedding=RED)) == [(1, "confirmed", "new")]
    assert stay(sort, 3, 1, person(3, 0, embedding=RED)) == [(1, "confirmed", "continued")]
    assert stay(sort, 4, 40) == []
    assert stay(sort, 44, 3, person(4, 1, embedding=RED)) == [(1, "confirmed", "reidentified")]
    (track,) = sort.update(frame(47, person(4, 1, embedding=RED)))
    assert (track.identity, track.hits) == ("continued", 4)
    assert track.identity_reason == "cosine distance 0.00 to 1"
    # A distance of 0: 1 / (1 + exp(-0.15 / 0.047)).
    assert track.identity_confidence == pytest.approx(0.9605, abs=1e-4)


def test_no_identity_without_the_policy() -> None:
    sort = tracker(IdentityConfig(enabled=False))
    assert stay(sort, 0, 4, person(3, 0, embedding=RED)) == [(1, "confirmed", None)]
    stay(sort, 4, 40)
    assert stay(sort, 44, 4, person(4, 1, embedding=RED)) == [(2, "confirmed", None)]


def test_new_person_gets_a_new_identity() -> None:
    sort = tracker()
    stay(sort, 0, 10, person(3, 0, embedding=RED))
    stay(sort, 10, 40)
    assert stay(sort, 50, 3, person(3, 0, embedding=BLUE)) == [(2, "confirmed", "new")]


def test_lost_track_ends_when_its_person_is_reidentified() -> None:
    # 2 m away after 0.5 s; the lost track ends.
    sort = tracker()
    stay(sort, 0, 10, person(3, -1, embedding=RED))
    stay(sort, 10, 3)
    assert stay(sort, 13, 3, person(3, 1, embedding=RED)) == [(1, "confirmed", "reidentified")]


@pytest.mark.parametrize(("first", "ids"), [(9, [1, 2]), (10, [1])])
def test_person_found_beside_another_is_not_that_one(first: int, ids: list[int]) -> None:
    # Equal embeddings, 1 m apart. One track is lost after frame 9; the other begins in that frame,
    # or in the next one: then both may be one person.
    strong = published(
        identity=IdentityConfig(enabled=True), a_max=9, sigma_measurement_m=0.1, distance_max_m=0.4
    )
    sort = build_strongsort3d(published_config(strongsort3d=strong))
    gone, new = person(3, -0.5, embedding=RED), person(3, 0.5, 1, 0.8, RED)
    stay(sort, 0, 9, gone)
    stay(sort, 9, 1, *([gone, new] if first == 9 else [gone]))
    assert [id_ for id_, _, _ in stay(sort, 10, 4, person(3, 0.5, embedding=RED))] == ids


def test_return_of_either_of_two_similar_people_is_uncertain() -> None:
    sort = tracker()
    stay(sort, 0, 10, person(3, 0, embedding=RED), person(3, 1, 1, 0.8, RED_TOO))
    stay(sort, 10, 40)
    tracks = [sort.update(frame(n, person(3, 0.5, embedding=RED))) for n in range(50, 53)]
    (track,) = tracks[-1]
    assert (track.id, track.state, track.identity) == (1, "confirmed", "reidentified")
    assert track.identity_confidence == pytest.approx(0.5, abs=0.05)


def test_of_two_similar_people_the_absent_one_returns() -> None:
    sort = tracker()
    here, gone = person(3, 0, embedding=RED), person(3, 1.5, 1, 0.8, RED_TOO)
    stay(sort, 0, 10, here, gone)
    stay(sort, 10, 40, here)
    results = stay(sort, 50, 3, here, person(4, 1.5, 1, 0.8, RED_TOO))
    assert results == [(1, "confirmed", "continued"), (2, "confirmed", "reidentified")]


def test_one_crop_decides_at_the_second_match() -> None:
    # RED left; a new track is published with the second match, as RED or as a new person.
    def published_ids(embedding: tuple[float, ...]) -> list[tuple[int, str, str | None]]:
        strong = published(identity=IdentityConfig(enabled=True), a_max=5, n_init=2)
        sort = build_strongsort3d(published_config(strongsort3d=strong))
        stay(sort, 0, 10, person(3, 0, embedding=RED))
        stay(sort, 10, 40)
        return stay(sort, 50, 2, person(3, 0, embedding=embedding))

    assert published_ids(BLUE) == [(2, "confirmed", "new")]
    assert published_ids(RED) == [(1, "confirmed", "reidentified")]


def test_posterior_of_a_known_person() -> None:
    # Log-odds (0.25 - 0.203) / 0.047 = 1 and (0.25 - 0.344) / 0.047 = -2: weights e, e^-2, and 1 of
    # a new person; e / (e + e^-2 + 1) = 0.7054.
    posterior = identity_posterior({1: 0.203, 2: 0.344}, 0.25)
    assert posterior == pytest.approx({None: 0.2595, 1: 0.7054, 2: 0.0351}, abs=1e-4)
    assert reason_of({1: 0.203, 2: 0.344}, 0.25) == "cosine distance 0.20 to 1, 0.34 to 2"


def test_posterior_beyond_the_limit_is_a_new_person() -> None:
    # -3 and -3: 1 / (1 + 2 e^-3) = 0.9094.
    assert identity_posterior({1: 0.391, 2: 0.391}, 0.25)[None] == pytest.approx(0.9094, abs=1e-4)
    assert reason_of({1: 0.391}, 0.25) == "cosine distance 0.39 to 1: above 0.25"
    assert identity_posterior({}, 0.25) == {None: 1.0}


def published_ids(sort: StrongSort3d, first: int, *embeddings: tuple[float, ...]) -> list[int]:
    """Return the identity of a person at 3 m in each frame, with these embeddings."""
    frames = [frame(first + n, person(3, 0, embedding=e)) for n, e in enumerate(embeddings)]
    return [t.id for one in frames for t in sort.update(one) if t.state == "confirmed"]


def test_new_person_of_a_young_track_is_taken_back() -> None:
    # RED left. Of three bad crops of RED the third confirms and the last two are compared: "new".
    # A change needs a mean distance of 0.15 - 0.047 ln 9 = 0.0467. With n good crops it is
    # 0.3 * 2 / (n + 2), or with BLUE 0.99 * 2 / (n + 2): 11 good crops, or 41, more than 2 s have.
    def ids(bad: tuple[float, ...]) -> list[int]:
        sort = tracker()
        stay(sort, 0, 10, person(3, 0, embedding=RED))
        stay(sort, 10, 40)
        return published_ids(sort, 50, bad, bad, bad, *[RED] * 45)

    similar = (1.0, 0.1, 1.0253)  # 0.3 from RED
    assert ids(similar) == [2] * 11 + [1] * 35
    assert ids(BLUE) == [2] * 46


def test_crops_of_a_wrong_identity_leave_the_gallery() -> None:
    # Two crops of a new person resemble RED, who left; the others do not.
    sort = tracker()
    stay(sort, 0, 10, person(3, 0, embedding=RED))
    stay(sort, 10, 40)
    found = published_ids(sort, 50, RED, RED, RED, *[BLUE] * 15)
    assert (found[0], found[-1]) == (1, 3)
    people = sort.known_people()
    assert people is not None
    (view,) = people.entries[1].views
    np.testing.assert_allclose(view, unit(RED))


def test_person_matched_since_a_track_began_is_not_that_track() -> None:
    # Twins: the first one leaves half a second after the second one came, and is not the other.
    sort = tracker()
    gone, new = person(3, -1, embedding=RED), person(3, 1, 1, 0.8, RED)
    for number in range(5):
        sort.update(frame(number, gone))
    for number in range(5, 10):
        sort.update(frame(number, gone, new))
    found = {t.id for n in range(10, 30) for t in sort.update(frame(n, new)) if t.detection == 1}
    assert found == {2}


def test_gallery_is_empty_after_a_reset() -> None:
    sort = tracker()
    stay(sort, 0, 10, person(3, 0, embedding=RED))
    sort.reset()
    assert stay(sort, 0, 3, person(3, 0, embedding=RED)) == [(2, "confirmed", "new")]


@pytest.mark.parametrize(("y_m", "identity"), [(1.5, None), (0.0, "continued")])
def test_track_cut_off_at_the_edge_ends_sooner(y_m: float, identity: str | None) -> None:
    # At 3 m and 1.5 m to the left: u = 320 - 300 = 20 px, less 50 px of half a width: cut off.
    # Half a second later a person of similar appearance (0.1) enters there.
    sort = build_strongsort3d(published_config(strongsort3d=ALL))
    for number in range(10):
        sort.update(with_pose(number, person(3, y_m, embedding=RED)))
    for number in range(10, 15):
        sort.update(with_pose(number))
    tracks = sort.update(with_pose(15, person(3, y_m, embedding=(1.0, 0.6, 0.0))))
    (found,) = (t for t in tracks if t.detection is not None)
    assert found.identity == identity


@pytest.mark.parametrize(("camera", "identity"), [("camera", 2), ("other", 1)])
def test_track_cut_off_at_the_edge_is_not_absent_before_its_camera_missed_it(
    camera: str, identity: int
) -> None:
    # Late frames of a camera count as misses no more than absent frames.
    sort = build_strongsort3d(published_config(strongsort3d=ALL))
    red = person(3, 1.5, embedding=RED)
    for number in range(10):
        sort.update(with_pose(number, red))
    for number in range(10, 13):
        sort.update(dataclasses.replace(with_pose(number), camera=camera))
    tracks = sort.update(dataclasses.replace(with_pose(13, red), camera="other"))
    assert [t.id for t in tracks if t.detection is not None] == [identity]


@pytest.mark.parametrize("y_m", [0.0, 1.0])
def test_person_hidden_at_the_edge_left(y_m: float) -> None:
    # RED, at 4 m, is last in view in the middle of the image or at its edge, then occluded by BLUE
    # for 1 s. A person of similar appearance appears there: RED in the middle, another one at the
    # edge.
    identity = IdentityConfig(enabled=True)
    strong = published(identity=identity, visibility=True)
    sort = build_strongsort3d(published_config(strongsort3d=strong))
    blue = person(2, y_m, index=1, embedding=BLUE)
    for number in range(10):
        sort.update(with_pose(number, person(4, 2 * y_m, embedding=RED)))
    for number in range(10, 20):
        sort.update(with_pose(number, blue))
    tracks = sort.update(with_pose(20, blue, person(4, 2 * y_m, embedding=(1.0, 0.6, 0.0))))
    (found,) = (t for t in tracks if t.detection == 0)
    assert (found.id == 1) == (y_m == 0)


@pytest.mark.parametrize("frames", [12, 55, 350])
@pytest.mark.parametrize("embedding", [RED, None])
def test_people_apart_continue_after_a_time_without_frames(
    frames: int, embedding: tuple[float, ...] | None
) -> None:
    # Cases: the same appearance or no embeddings after the pause.
    sort = tracker()
    people = [person(3, y, index, embedding=RED) for index, y in enumerate((-1.0, 1.0))]
    stay(sort, 0, 10, *people)
    moved = [person(3.2, y + 0.2, index, embedding=embedding) for index, y in enumerate((-1, 1))]
    found = stay(sort, 10 + frames - 1, 1, *moved)
    expected = [(1, "confirmed", "continued"), (2, "confirmed", "continued")]
    assert found == (expected if frames < 300 else [])  # ABSENCE_MAX_S


def test_people_near_each_other_are_reidentified_after_a_time_without_frames() -> None:
    # The people changed places.
    sort = tracker()
    both = person(3, -0.3, 0, embedding=RED), person(3, 0.3, 1, embedding=BLUE)
    (red,) = (
        t.id for t in [sort.update(frame(n, *both)) for n in range(10)][-1] if t.detection == 0
    )
    changed = person(3, -0.2, 0, embedding=BLUE), person(3, 0.2, 1, embedding=RED)
    tracks = [sort.update(frame(number, *changed)) for number in range(25, 35)][-1]
    assert {t.id: t.detection for t in tracks} == {red: 1, 3 - red: 0}


def test_appearance_decides_after_a_time_without_frames() -> None:
    sort = tracker()
    stay(sort, 0, 10, person(3, 0, embedding=RED))
    assert stay(sort, 25, 3, person(3, 0, embedding=BLUE))[-1] == (2, "confirmed", "new")


def test_absent_track_ends_and_an_occluded_one_does_not() -> None:
    # Ten frames a second; unseen for 1.1 s: frames 5 to 15.
    def lasts(*others: Measurement) -> bool:
        strong = published(identity=IdentityConfig(enabled=True), visibility=True)
        sort = build_strongsort3d(published_config(strongsort3d=strong))
        tracks: list[Track] = []
        for number in range(5):
            sort.update(with_pose(number, person(3, 0, embedding=RED)))
        for number in range(5, 17):
            tracks = sort.update(with_pose(number, *others))
        return 1 in [track.id for track in tracks]

    assert not lasts()
    assert lasts(person(2, 0, embedding=BLUE))


@pytest.mark.parametrize(("missed", "identity"), [(1, 1), (3, 2)])
def test_track_at_the_edge_goes_on_in_the_next_frame_of_a_slow_camera(
    missed: int, identity: int
) -> None:
    # Frames 0.5 s apart are longer than EMPTY_AT_EDGE_S; each missed one counts 0.2 s.
    sort = build_strongsort3d(published_config(strongsort3d=ALL))
    for number in range(5):
        sort.update(with_pose(5 * number, person(3, 1.5, embedding=RED)))
    for number in range(5, 4 + missed):
        sort.update(with_pose(5 * number))
    similar = person(3, 1.5, embedding=(1.0, 0.6, 0.0))
    tracks = sort.update(with_pose(5 * (4 + missed), similar))
    assert [track.id for track in tracks if track.detection is not None] == [identity]
