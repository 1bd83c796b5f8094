"""Contract of every tracker: invariants, life cycle and checkpoints."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.geometry.transforms import rotation_from_rpy
from people4d.errors import DecodeError
from people4d.messages import F64, Track
from services.tracker.build import TRACKERS, make_tracker
from services.tracker.config import ImageSortConfig
from services.tracker.interface import Measurement, Observation, Tracker
from services.tracker.strongsort3d.config import IdentityConfig
from tests.tracker.scene import BLUE, FRAME_NS, RED, frame, person, published, published_config

ALL_POLICIES = "strongsort3d with all policies"
STRONG = published(noise="measured", visibility=True, identity=IdentityConfig())
CONFIGS = {
    name: published_config(tracker=name, image_sort=ImageSortConfig(min_hits=0), yaw="kalman")
    for name in TRACKERS
} | {ALL_POLICIES: published_config(strongsort3d=STRONG, yaw="keypoints")}
every_tracker = pytest.mark.parametrize("name", CONFIGS)


def make(name: str) -> Tracker:
    return make_tracker(CONFIGS[name])


def scene(seed: int, frames: int = 25, people: int = 4) -> list[Observation]:
    """Randomly walking people, with misses, noise and uneven time steps."""
    rng = np.random.default_rng(seed)
    positions, speeds = (
        rng.uniform([2, -1.5], [5, 1.5], (people, 2)),
        rng.normal(0, 0.8, (people, 2)),
    )
    embeddings, stamp_ns, results = rng.normal(size=(people, 8)), 0, []
    for _ in range(frames):
        step_ns = int(rng.integers(0, 2 * FRAME_NS))
        stamp_ns += step_ns
        positions = np.maximum(positions + speeds * step_ns / 1e9, [1.0, -9.0])
        noisy = positions + rng.normal(0, 0.05, positions.shape)
        detected = [
            person(
                noisy[k, 0],
                noisy[k, 1],
                index=k,
                score=float(rng.uniform(0.3, 1.0)),
                embedding=embeddings[k] + rng.normal(0, 0.2, 8) if rng.random() < 0.9 else None,
            )
            for k in range(people)
            if rng.random() < 0.85
        ]
        results.append(
            Observation(stamp_ns=stamp_ns, measurements=tuple(detected), embedder="histogram")
        )
    return results


def run(tracker: Tracker, observations: list[Observation]) -> list[list[Track]]:
    return [tracker.update(observation) for observation in observations]


def assert_same(a: list[list[Track]], b: list[list[Track]]) -> None:
    for one, other in zip(a, b, strict=True):
        for x, y in zip(one, other, strict=True):
            for field in Track.__struct_fields__:
                np.testing.assert_array_equal(getattr(x, field), getattr(y, field))


@every_tracker
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000), data=st.data())
def test_result_is_independent_of_the_order_of_detections(
    name: str, seed: int, data: st.DataObject
) -> None:
    straight = scene(seed, frames=10)
    shuffled = [
        dataclasses.replace(o, measurements=tuple(data.draw(st.permutations(o.measurements))))
        for o in straight
    ]
    assert_same(run(make(name), straight), run(make(name), shuffled))


def moved(measurement: Measurement, rotation: F64, shift: F64) -> Measurement:
    return dataclasses.replace(measurement, position_m=rotation @ measurement.position_m + shift)


@pytest.mark.parametrize("name", TRACKERS)
@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    angles=st.tuples(*[st.floats(-3, 3)] * 3),
    shift=st.tuples(*[st.floats(-20, 20)] * 3),
)
def test_tracks_move_with_the_world(
    name: str, seed: int, angles: tuple[float, ...], shift: tuple[float, ...]
) -> None:
    rotation, offset = rotation_from_rpy(*angles), np.array(shift)
    here = scene(seed, frames=10)
    there = [
        dataclasses.replace(
            o, measurements=tuple(moved(m, rotation, offset) for m in o.measurements)
        )
        for o in here
    ]
    turn = np.kron(np.eye(2), rotation)
    for one, other in zip(run(make(name), here), run(make(name), there), strict=True):
        assert [(t.id, t.state, t.detection) for t in one] == [
            (t.id, t.state, t.detection) for t in other
        ]
        for a, b in zip(one, other, strict=True):
            np.testing.assert_allclose(rotation @ a.position_m + offset, b.position_m, atol=1e-8)
            np.testing.assert_allclose(rotation @ a.velocity_mps, b.velocity_mps, atol=1e-8)
            np.testing.assert_allclose(turn @ a.covariance @ turn.T, b.covariance, atol=1e-8)


@every_tracker
@settings(max_examples=40, deadline=None)
@given(
    steps_s=st.lists(st.floats(0, 4.9), min_size=1, max_size=12),
    scores=st.lists(st.sampled_from([0.0, 0.5, 1.0]), min_size=12, max_size=12),
    detected=st.lists(st.booleans(), min_size=12, max_size=12),
)
def test_covariances_stay_symmetric_and_positive_definite(
    name: str, steps_s: list[float], scores: list[float], detected: list[bool]
) -> None:
    tracker, stamp_ns = make(name), 0
    for step_s, score, here in zip(steps_s, scores, detected, strict=False):
        stamp_ns += int(step_s * 1e9)
        people = (person(3, 0.5, score=score),) * here
        for track in tracker.update(Observation(stamp_ns=stamp_ns, measurements=people)):
            np.testing.assert_allclose(track.covariance, track.covariance.T, rtol=1e-9)
            np.linalg.cholesky(track.covariance)


@pytest.mark.parametrize("name", ["sort3d", "strongsort3d"])
def test_life_cycle_of_the_papers_in_five_frames(name: str) -> None:
    tracker = make(name)
    states = [[(t.id, t.state) for t in tracker.update(frame(k, person(3, 0)))] for k in range(3)]
    assert states == [[(1, "tentative")], [(1, "tentative")], [(1, "confirmed")]]
    (lost,) = tracker.update(frame(3))
    assert (lost.id, lost.state, lost.detection) == (1, "lost", None)
    assert lost.time_since_update_s == pytest.approx(0.1)
    (back,) = tracker.update(frame(4, person(3, 0, index=7, score=0.6)))
    assert (back.id, back.state, back.detection, back.score) == (1, "confirmed", 7, 0.6)
    assert (back.hits, back.age, back.time_since_update_s) == (4, 5, 0.0)


@every_tracker
def test_empty_frames(name: str) -> None:
    tracker = make(name)
    assert run(tracker, [frame(k) for k in range(5)]) == [[]] * 5
    assert tracker.predict(10 * FRAME_NS) == []


@every_tracker
def test_zero_time_between_frames_adds_no_uncertainty(name: str) -> None:
    tracker = make(name)
    (before,) = tracker.update(frame(0, person(3, 0)))
    (after,) = tracker.update(frame(0, person(3, 0)))
    assert after.id == before.id
    assert np.trace(after.covariance) < np.trace(before.covariance)


@every_tracker
def test_a_gap_of_two_seconds_keeps_a_standing_person(name: str) -> None:
    tracker = make(name)
    for number in range(5):
        tracker.update(frame(number, person(3, 0)))
    (track,) = tracker.update(frame(25, person(3, 0)))
    assert (track.id, track.state) == (1, "confirmed")
    assert np.all(np.isfinite(track.covariance))


def test_a_walking_person_is_found_again_after_three_seconds_without_detector() -> None:
    # 1 m/s sideways for 2 s, then no detections for 3 s: prediction and uncertainty continue.
    tracker = make("strongsort3d")
    for number in range(20):
        tracker.update(frame(number, person(4, -2.5 + 0.1 * number)))
    (track,) = tracker.update(frame(49, person(4, 2.4)))
    assert (track.id, track.state) == (1, "confirmed")


@every_tracker
def test_gap_beyond_the_limit_ends_all_tracks(name: str) -> None:
    tracker = make(name)
    for number in range(5):
        tracker.update(frame(number, person(3, 0)))
    assert [track.id for track in tracker.update(frame(10**9, person(3, 0)))] == [2]


@every_tracker
def test_reset_deletes_tracks_but_keeps_identities_used(name: str) -> None:
    tracker = make(name)
    tracker.update(frame(5, person(3, 0)))
    tracker.reset()
    assert [track.id for track in tracker.update(frame(0, person(3, 0)))] == [2]


@every_tracker
def test_identities_are_never_used_again(name: str) -> None:
    tracker, began = make(name), dict[int, int]()
    alive: set[int] = set()
    gone: set[int] = set()
    for number in range(300):
        here = number % 4 < 2  # two matched frames, two missed frames
        tracks = tracker.update(frame(number * 17, *[person(3, 0)] * here))
        now = {track.id for track in tracks}
        gone |= alive - now
        assert not now & gone
        alive = now
        for track in tracks:
            began.setdefault(track.id, number)
    assert sorted(began) == list(range(1, len(began) + 1))
    assert len(began) > 68


@every_tracker
def test_predicting_changes_nothing(name: str) -> None:
    observations = scene(11)
    quiet, asked = make(name), make(name)
    expected = run(quiet, observations)
    results = []
    for observation in observations:
        results.append(asked.update(observation))
        asked.predict(observation.stamp_ns + 3 * FRAME_NS)
    assert_same(expected, results)


@every_tracker
def test_frames_of_other_cameras_do_not_make_tracks_stiff(name: str) -> None:
    def last(others: int) -> Track:
        tracker = make(name)
        for number in range(20):
            (track,) = tracker.update(frame(number, person(3, 0.1 * number), camera="a"))
            for k in range(others):
                later_ns = (k + 1) * FRAME_NS // (others + 1)
                empty = frame(number, camera=f"b{k}")
                tracker.update(dataclasses.replace(empty, stamp_ns=empty.stamp_ns + later_ns))
        return track

    alone, among = last(0), last(3)
    np.testing.assert_allclose(np.diag(among.covariance), np.diag(alone.covariance), rtol=0.05)
    np.testing.assert_allclose(among.position_m, alone.position_m, atol=1e-3)
    np.testing.assert_allclose(among.velocity_mps, alone.velocity_mps, atol=1e-2)


@every_tracker
def test_prediction_moves_and_grows_uncertain_until_the_track_ends(name: str) -> None:
    tracker = make(name)
    for number in range(10):
        (now,) = tracker.update(frame(number, person(3, 0.05 * number)))
    (soon,) = tracker.predict(10 * FRAME_NS)
    (later,) = tracker.predict(29 * FRAME_NS)
    assert (soon.state, soon.detection) == ("lost", None)
    np.testing.assert_allclose(later.position_m, now.position_m + 2.0 * now.velocity_mps)
    assert later.time_since_update_s == pytest.approx(2.0)
    assert now.covariance[0, 0] < soon.covariance[0, 0] < later.covariance[0, 0]
    assert tracker.predict(60 * FRAME_NS) == []


def two_people(number: int) -> Observation:
    """Two people walking towards the camera at 1 m/s."""
    red = person(5.0 - 0.1 * number, -1.0, 0, embedding=RED)
    return frame(number, red, person(6.0 - 0.1 * number, 1.0, 1, embedding=BLUE))


def restarted(name: str, before: Tracker) -> Tracker:
    after = make(name)
    after.restore(before.save())
    return after


@every_tracker
def test_restored_tracker_continues_identically(name: str) -> None:
    first = make(name)
    run(first, [two_people(k) for k in range(10)])
    second, rest = restarted(name, first), [two_people(k) for k in range(10, 15)]
    expected = run(first, rest)
    assert [[t.id for t in tracks] for tracks in expected] == [[1, 2]] * 5
    assert_same(expected, run(second, rest))


@every_tracker
def test_identity_of_a_deleted_track_is_not_given_again_after_a_restart(name: str) -> None:
    first = make(name)
    run(first, [two_people(k) for k in range(5)])
    for k in range(400, 403):  # 40 s later
        (track,) = first.update(frame(k, person(8.0, 3.0, embedding=(0.0, 1.0, 0.0))))
    assert track.id == 3
    first.update(frame(800))  # deleted
    second = restarted(name, first)
    for k in range(1200, 1203):
        (track,) = second.update(frame(k, person(3.0, 0.0, embedding=(0.5, 0.5, 0.0))))
    assert track.id == 4


@pytest.mark.parametrize("name", ["strongsort3d", ALL_POLICIES])
def test_standing_people_keep_their_identities_over_a_restart_of_two_seconds(name: str) -> None:
    first = make(name)
    for k in range(10):
        first.update(frame(k, person(4, -1, embedding=RED), person(4, 1, 1, embedding=BLUE)))
    second = restarted(name, first)
    # After 2 s both are 0.3 m farther, in another order. At equal scores the left one began first.
    blue, red = person(4.3, 1.0, 0, embedding=BLUE), person(3.7, -1.0, 1, embedding=RED)
    for k in range(29, 35):
        tracks = second.update(frame(k, blue, red))
    assert {t.id: round(float(t.position_m[1])) for t in tracks} == {1: 1, 2: -1}


def test_person_is_reidentified_after_a_restart() -> None:
    first = make(ALL_POLICIES)
    run(first, [two_people(k) for k in range(10)] + [frame(k) for k in range(10, 60)])
    second = restarted(ALL_POLICIES, first)
    for k in range(60, 70):
        tracks = second.update(frame(k, person(4.0, -1.0, embedding=RED)))
    assert [(t.id, t.identity) for t in tracks] == [(2, "continued")]  # red, to the right


@every_tracker
def test_bytes_that_are_no_checkpoint_are_refused_without_effect(name: str) -> None:
    good = make(name)
    run(good, [two_people(k) for k in range(5)])
    for bad in (b"", good.save()[:-1], b"\x80", bytes(range(256))):
        target = make(name)
        with pytest.raises(DecodeError, match="checkpoint"):
            target.restore(bad)
        assert [t.id for t in run(target, [two_people(k) for k in range(3)])[-1]] == [1, 2]
