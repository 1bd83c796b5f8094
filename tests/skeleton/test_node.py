"""Node of skeletons."""

from typing import Any

import msgspec
import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL
from people4d.messages import F64, JOINTS, Detections, Skeletons
from services.skeleton.body import yaw_rotations
from services.skeleton.build import build
from services.skeleton.config import SkeletonConfig
from services.skeleton.node import FRAMES_MAX
from services.skeleton.posture import ANKLES, HIPS, KNEES
from tests.builders import (
    camera_info,
    detection,
    detections,
    odometry,
    static_transform,
    track,
    tracks,
)
from tests.skeleton.walker import (
    INFO,
    LEFT_ELBOW,
    LEFT_WRIST,
    PERIOD_NS,
    POSE,
    RIGHT_WRIST,
    Walker,
    answer,
    errors_m,
    person,
    ready,
)


def walk(walker: Walker, count: int, hidden_from: int = 1000, **hidden: Any) -> list[Skeletons]:
    """Return the skeletons of a walk; joints are hidden after a number of frames."""
    node = ready()
    return [
        answer(node, walker.frame(n, **(hidden if n >= hidden_from else {})), walker.people(n))
        for n in range(count)
    ]


def test_skeletons_have_stamp_frame_and_people_of_the_tracks() -> None:
    walker = Walker()
    found = answer(ready(), walker.frame(3), walker.people(3, id=7))
    assert (found.stamp_ns, found.frame_id, found.camera) == (3 * PERIOD_NS, "map", "front")
    assert (person(found).id, person(found).state) == (7, "confirmed")


def test_visible_joints_are_measured() -> None:
    walker = Walker()
    found = walk(walker, 20)[-1]
    assert all(person(found).measured)
    assert errors_m(found, walker, 19).max() < 0.03


class RaisedHand(Walker):
    """Person with a raised left hand; the elbow is hidden by the body."""

    def joints_m(self, number: int) -> F64:
        joints = super().joints_m(number)
        above_m = joints[LEFT_ELBOW - 2][2]
        joints[LEFT_ELBOW] = (*joints[LEFT_ELBOW - 2][:2], above_m + 0.28)
        joints[LEFT_WRIST] = (*joints[LEFT_ELBOW - 2][:2], above_m + 0.53)
        return joints

    def frame(self, number: int, hidden: tuple[int, ...] = (), **fields: Any) -> Detections:
        message = super().frame(number, hidden, **fields)
        (found,) = message.detections
        keypoints = np.array(found.keypoints)
        keypoints[LEFT_ELBOW, 2] = 0.3
        found = msgspec.structs.replace(found, keypoints=keypoints)
        return msgspec.structs.replace(message, detections=(found,))


def test_hidden_elbow_follows_a_raised_wrist() -> None:
    walker = RaisedHand()
    found = walk(walker, 20, hidden_from=0, hidden=(LEFT_ELBOW,))[-1]
    assert person(found).measured[LEFT_WRIST]
    assert not person(found).measured[LEFT_ELBOW]
    assert errors_m(found, walker, 19)[[LEFT_ELBOW, LEFT_WRIST]].max() < 0.1


@pytest.mark.parametrize("size", [0.55, 0.75, 1.0])
def test_stature_follows_the_size_within_its_deviation(size: float) -> None:
    usual = person(walk(Walker(), 40)[-1])
    first, *_, last = (person(found) for found in walk(Walker(size=size), 40))
    assert first.stature_sigma_m is not None
    assert last.stature_sigma_m is not None
    assert usual.stature_m is not None
    assert last.stature_sigma_m < first.stature_sigma_m
    assert last.stature_m == pytest.approx(size * usual.stature_m, abs=2 * last.stature_sigma_m)
    assert last.child > 0.9 if size < 1 else last.child < 0.05


def test_stature_of_a_child_without_visible_legs_follows_from_the_torso() -> None:
    usual, hidden = person(walk(Walker(), 40)[-1]), (13, 14, 15, 16)
    found = person(walk(Walker(size=0.55), 40, hidden_from=0, hidden=hidden)[-1])
    assert usual.stature_m is not None
    assert found.stature_m == pytest.approx(0.55 * usual.stature_m, rel=0.12)


class Seated(Walker):
    """Seated person: the torso is 4 cm shorter, and thighs by 8 cm, since the lap hides hips."""

    def joints_m(self, number: int) -> F64:
        joints = super().joints_m(number)
        joints[:11, 2] -= 0.04 * self.size
        forward = yaw_rotations(np.array([self.yaw_rad]))[0][:, 0]
        joints[KNEES] = joints[HIPS] + 0.4 * self.size * forward
        joints[ANKLES] = joints[KNEES] - (0.0, 0.0, 0.35 * self.size)
        joints[HIPS] += 0.08 * self.size * forward
        return joints


@pytest.mark.parametrize("size", [0.9, 1.0])
def test_stature_of_a_seated_person_follows_the_size(size: float) -> None:
    usual, seated = (person(walk(one, 160)[-1]) for one in (Walker(), Seated(size=size)))
    assert seated.posture == "sitting"
    assert usual.stature_m is not None
    assert seated.stature_m == pytest.approx(size * usual.stature_m, rel=0.07)


def test_hidden_joints_are_predicted_with_a_larger_covariance() -> None:
    walker, hidden = Walker(), (LEFT_WRIST, LEFT_ELBOW)
    found = walk(walker, 30, 20, hidden=hidden)
    before, after = found[19], found[29]
    measured = person(after).measured
    assert [JOINTS[n] for n in range(17) if not measured[n]] == ["left_elbow", "left_wrist"]
    assert errors_m(after, walker, 29)[list(hidden)].max() < 0.12
    for joint in hidden:
        spread = [np.trace(person(one).covariances_m2[joint]) for one in (before, after)]
        assert spread[1] > 2 * spread[0]


def test_joints_of_a_lost_track_follow_the_track() -> None:
    walker, node = Walker(), ready()
    for number in range(20):
        answer(node, walker.frame(number), walker.people(number))
    for number in range(20, 30):
        lost = walker.people(number, state="lost", detection=None)
        found = answer(node, detections(stamp_ns=number * PERIOD_NS), lost)
    assert person(found).state == "lost"
    assert not any(person(found).measured)
    assert np.median(errors_m(found, walker, 29)) < 0.05


def test_person_without_depth_has_the_usual_pose_at_the_track() -> None:
    walker, node = Walker(), ready()
    for number in range(20):
        frame = walker.frame(number, keypoint_depths_m=None)
        found = answer(node, frame, walker.people(number))
    assert not any(person(found).measured)
    assert np.median(errors_m(found, walker, 19)) < 0.08


@pytest.mark.parametrize("size", [0.85, 1.15])
def test_lengths_of_bones_are_learned_for_each_person(size: float) -> None:
    walker, node = Walker(size, swing_m=0.0, yaw_rad=np.pi), ready()
    for number in range(60):
        answer(node, walker.frame(number), walker.people(number, id=5))
    hidden = (13, 14, 15, 16)
    for number in range(60, 70):
        found = answer(node, walker.frame(number, hidden=hidden), walker.people(number, id=5))
    joints, estimated = walker.joints_m(0), person(found).positions_m
    for first, second in ((5, 7), (7, 9), (11, 13), (13, 15)):
        true_m = np.linalg.norm(joints[first] - joints[second])
        assert np.linalg.norm(estimated[first] - estimated[second]) == pytest.approx(
            true_m, abs=0.03
        )


def test_sides_exchanged_in_one_frame_are_corrected() -> None:
    walker, node = Walker(yaw_rad=np.pi / 2 + 0.8), ready()
    for number in range(15):
        answer(node, walker.frame(number), walker.people(number))
    frame = walker.frame(15).detections[0]
    assert frame.keypoints is not None
    assert frame.keypoint_depths_m is not None
    order = [*range(7), 8, 7, 10, 9, *range(11, 17)]
    order[5], order[6] = 6, 5
    exchanged = walker.frame(
        15, keypoints=frame.keypoints[order], keypoint_depths_m=frame.keypoint_depths_m[order]
    )
    found = answer(node, exchanged, walker.people(15))
    assert errors_m(found, walker, 15)[[LEFT_WRIST, RIGHT_WRIST]].max() < 0.1


def test_joints_are_accurate_with_unknown_yaw() -> None:
    walker, node = Walker(), ready()
    for number in range(20):
        found = answer(node, walker.frame(number), walker.people(number, yaw_rad=None))
    assert np.median(errors_m(found, walker, 19)) < 0.03


def test_skeleton_restarts_at_a_track_that_jumps() -> None:
    walker, node = Walker(), ready()
    for number in range(10):
        answer(node, walker.frame(number), walker.people(number))
    elsewhere = np.array([5.0, 2.0, 1.2])
    moved = walker.people(10, position_m=elsewhere, state="lost", detection=None)
    found = answer(node, walker.frame(10), moved)
    assert np.linalg.norm(person(found).positions_m[:, :2] - elsewhere[:2], axis=1).max() < 0.5


def test_missing_inputs_are_counted() -> None:
    walker, node = Walker(), build(SkeletonConfig(people_max=1))
    assert not node.handle(walker.people(0), 0)
    node.handle(walker.frame(1), 0)
    assert not node.handle(walker.people(1), 0)
    node.handle(INFO, 0)
    node.handle(static_transform(LINK_FROM_OPTICAL, parent="base_link"), 0)
    node.handle(odometry(stamp_ns=200 * PERIOD_NS, frame_id="map"), 0)
    node.handle(walker.frame(200), 0)
    assert node.handle(walker.people(200), 0)
    node.handle(walker.frame(0), 0)
    assert not node.handle(walker.people(0), 0)
    node.handle(static_transform(POSE), 0)
    twice = [track(id=4), track(id=4), track(id=5), track(id=6, state="tentative")]
    found = answer(node, walker.frame(3), tracks(*twice, stamp_ns=3 * PERIOD_NS))
    assert [one.id for one in found.people] == [4]
    assert not node.handle(walker.people(2), 0)
    counters = {name: count for name, count in node.status().counters.items() if count}
    expected = {"no_detections": 1, "no_camera_info": 1, "no_transform": 1, "stale": 1}
    assert counters == expected | {"repeated": 1, "too_many": 1, "clock_resets": 1}


def test_clock_reset_restarts_skeletons() -> None:
    walker, node = Walker(), ready()
    for number in (100, 101, 0, 1):
        found = answer(node, walker.frame(number), walker.people(number))
    assert node.status().counters["clock_resets"] == 1
    assert errors_m(found, walker, 1).max() < 0.06


def test_detections_without_tracks_and_invented_cameras_are_limited() -> None:
    walker, node = Walker(), ready()
    node.handle(walker.frame(0), 0)
    for number in range(FRAMES_MAX):
        node.handle(detections(detection(), stamp_ns=1 + number), 0)
        node.handle(camera_info(camera=f"c{number}"), 0)
    assert not node.handle(walker.people(0), 0)  # newer detections evicted its detections
    assert node.status().counters["no_detections"] == 1
