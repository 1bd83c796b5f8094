"""Choice of the person that holds up a hand."""

import numpy as np
import pytest

from people4d.messages import PersonSkeleton, Skeletons
from services.skeleton.body import USUAL_POSE_M
from services.target.choice import NO_BASE
from tests import builders
from tests.target.scene import BLUE, RED, Scene

PEOPLE = {1: (3.0, 0.0, RED), 2: (5.0, 2.0, BLUE)}
NO_HAND = "no person in view holds up a hand"


def skeletons(scene: Scene, raised: set[int], hidden: bool = False) -> Skeletons:
    """Return skeletons of the last frame; the right hand of `raised` is above the head."""
    people = []
    for number in PEOPLE:
        joints = USUAL_POSE_M.astype(np.float32)
        if number in raised:
            joints[[8, 10], 2] = 0.45, 0.7
        people.append(
            PersonSkeleton(
                id=number,
                state="confirmed",
                positions_m=joints,
                covariances_m2=np.tile(1e-4 * np.eye(3, dtype=np.float32), (17, 1, 1)),
                measured=tuple(joint not in (9, 10) or not hidden for joint in range(17)),
            )
        )
    return Skeletons(
        stamp_ns=scene.stamp_ns, sequence=0, frame_id="map", camera="front", people=tuple(people)
    )


def waiting() -> Scene:
    """Return a scene with a choice by a raised hand."""
    scene = Scene()
    scene.choose("raised_hand")
    return scene


def show(scene: Scene, count: int, raised: set[int], hidden: bool = False) -> list[int | None]:
    """Return the chosen person in a number of frames with skeletons."""
    found = []
    for _ in range(count):
        found.append(scene.frame(PEOPLE).id)
        scene.node.handle(skeletons(scene, raised, hidden), 0)
    return found


def test_person_with_a_hand_raised_for_a_second_is_chosen() -> None:
    found = show(waiting(), 20, {2})
    # Frames are 0.1 s apart: 11 skeletons last 1 s, and the frame after them chooses.
    assert found == 11 * [None] + 9 * [2]


def test_hand_that_is_lowered_too_early_chooses_no_person() -> None:
    scene = waiting()
    for _ in range(5):
        assert set(show(scene, 10, {2}) + show(scene, 1, set())) == {None}


def test_no_raised_hand_is_reported_and_ends_after_a_wait() -> None:
    scene = waiting()
    show(scene, 10, set())
    target = scene.frame(PEOPLE)
    assert (target.state, target.reason, target.stop) == ("searching", NO_HAND, True)
    show(scene, 300, set())
    target = scene.frame(PEOPLE)
    assert (target.state, target.reason) == ("none", f"no person is chosen: {NO_HAND}")


def test_hidden_hand_chooses_no_person() -> None:
    assert set(show(waiting(), 20, {2}, hidden=True)) == {None}


def test_without_skeletons_the_remedy_is_named() -> None:
    scene = waiting()
    expected = "no skeletons arrive, see people4d up --skeletons"
    assert scene.frame(PEOPLE).reason == expected
    show(scene, 5, {2})
    assert scene.frames(20, PEOPLE).reason == expected


@pytest.mark.parametrize(("x_m", "nearest"), [(2.0, 1), (6.0, 2)])
def test_nearest_of_several_people_with_a_raised_hand_is_chosen(x_m: float, nearest: int) -> None:
    scene = waiting()
    pose = np.eye(4)
    pose[:2, 3] = x_m, 1.0
    scene.node.handle(builders.static_transform(pose, "base_link"), 0)
    assert show(scene, 20, {1, 2})[-1] == nearest


def test_several_raised_hands_without_the_pose_of_the_robot_choose_no_person() -> None:
    scene = waiting()
    assert set(show(scene, 20, {1, 2})) == {None}
    assert scene.frame(PEOPLE).reason == NO_BASE


def test_clock_reset_begins_the_time_of_a_raised_hand_again() -> None:
    scene = waiting()
    show(scene, 8, {2})
    scene.stamp_ns -= 5_000_000_000
    assert show(scene, 20, {2}) == 11 * [None] + 9 * [2]


def test_raised_hand_of_a_track_that_has_ended_chooses_no_person() -> None:
    scene = waiting()
    for _ in range(20):
        assert scene.frame({1: PEOPLE[1]}).id is None
        scene.node.handle(skeletons(scene, {2}), 0)
