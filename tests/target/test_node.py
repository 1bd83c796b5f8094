"""Commands, distances and paths of the node of the chosen person."""

import math

import numpy as np
import pytest

from people4d.errors import DecodeError
from people4d.messages import (
    MotionProbabilities,
    PersonPrediction,
    Predictions,
    TargetCommand,
)
from services.target.build import build
from services.target.config import TargetConfig
from tests import builders
from tests.target.scene import BLUE, RED, Scene, followed


def pose(x_m: float, y_m: float, yaw_deg: float) -> np.ndarray:
    c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    return np.array([[c, -s, 0, x_m], [s, c, 0, y_m], [0, 0, 1, 0], [0, 0, 0, 1]])


def test_choice_of_an_unknown_id_ends_after_a_wait() -> None:
    scene = Scene()
    scene.choose(id=9)
    targets = [scene.frame({1: (3, 0, RED)}) for _ in range(60)]
    assert (targets[0].state, targets[0].reason) == ("searching", "person 9 is not in view")
    assert targets[-1].state == "none"
    assert targets[-1].reason == "no person is chosen: person 9 is not in view"
    assert all(target.stop for target in targets)


def test_person_at_a_position_is_chosen() -> None:
    scene = Scene()
    scene.choose("at", position_m=np.array([5.5, 2.0]))
    assert scene.frame({1: (3, 0, RED), 2: (5, 2, BLUE)}).id == 2


def test_empty_position_is_reported() -> None:
    scene = Scene()
    scene.choose("at", position_m=np.array([8.0, 2.0]))
    target = scene.frame({1: (3, 0, RED)})
    assert (target.state, target.reason) == (
        "searching",
        "no person is in view within 1 m of (8.0, 2.0)",
    )


def test_nearest_person_to_the_robot_is_chosen() -> None:
    scene = Scene()
    scene.node.handle(builders.static_transform(pose(6, 2, 0), "base_link"), 0)
    scene.choose("nearest")
    assert scene.frame({1: (3, 0, RED), 2: (5, 2, BLUE)}).id == 2


def test_nearest_person_needs_the_pose_of_the_robot() -> None:
    scene = Scene()
    scene.choose("nearest")
    target = scene.frame({1: (3, 0, RED)})
    assert target.reason == (
        "the nearest person is unknown without the pose of the robot's base: with a fixed camera, "
        "set target.base_frame to map"
    )


def test_distance_and_bearing_are_from_the_base() -> None:
    # The robot is at (3, -4) and looks along +y: the person at (3, 0) is 4 m ahead.
    scene = followed()
    scene.node.handle(builders.static_transform(pose(3, -4, 90), "base_link"), 0)
    target = scene.frame({1: (3, 0, RED)})
    assert target.distance_m == pytest.approx(4)
    assert target.bearing_rad == pytest.approx(0)
    # At (1, -4) it is at 2 m to the left.
    target = scene.frame({1: (1, -4, RED)})
    assert target.bearing_rad == pytest.approx(math.pi / 2)


def test_distance_is_absent_without_a_pose() -> None:
    target = followed().frame({1: (3, 0, RED)})
    assert (target.distance_m, target.bearing_rad) == (None, None)


def test_choice_is_cleared() -> None:
    scene = followed()
    scene.choose("none")
    assert scene.frame({1: (3, 0, RED)}).state == "none"


def test_last_of_two_choosers_wins_and_the_other_is_reported() -> None:
    scene = Scene()
    scene.choose(id=1, chooser="planner")
    scene.frame({1: (3, 0, RED), 2: (5, 2, BLUE)})
    scene.choose(id=2, chooser="operator")
    target = scene.frame({1: (3, 0, RED), 2: (5, 2, BLUE)})
    assert (target.id, target.chooser) == (2, "operator")
    assert target.reason.endswith("; chosen in place of 'planner'")
    counters = scene.node.status().counters
    assert (counters["commands"], counters["replaced_choices"]) == (2, 1)


def test_robot_stops_at_predicted_tracks() -> None:
    scene = followed()
    target = scene.frame({1: (3, 0, RED)}, predicted=True)
    assert (target.state, target.stop, target.reason) == ("searching", True, "no frames arrive")


def test_path_is_counted_from_the_stamp_of_the_target() -> None:
    # Predicted 0.1 s before: horizons of 0.5 and 1.0 s are 0.4 and 0.9 s ahead.
    scene = followed()
    person = PersonPrediction(
        id=1,
        state="confirmed",
        position_m=np.array([3.0, 0.0, 1.0]),
        velocity_mps=np.zeros(2),
        motion=MotionProbabilities(standing=1.0, going_on=0.0, turning=0.0),
        means_m=np.array([[3.5, 0.0], [4.0, 0.0]]),
        covariances_m2=np.array([np.eye(2), np.eye(2)]),
    )
    scene.node.handle(
        Predictions(
            stamp_ns=scene.stamp_ns,
            sequence=0,
            frame_id="map",
            camera="front",
            horizons_s=(0.5, 1.0),
            people=(person,),
        ),
        0,
    )
    target = scene.frame({1: (3, 0, RED)})
    assert target.path_times_s == pytest.approx((0.4, 0.9))
    assert target.path_m is not None
    np.testing.assert_allclose(target.path_m, [[3.5, 0.0], [4.0, 0.0]])
    assert scene.frames(12, {1: (3, 0, RED)}).path_m is None


def test_stale_tracks_are_counted_and_dropped() -> None:
    scene = followed()
    late = builders.tracks(stamp_ns=scene.stamp_ns - 1)
    assert scene.node.handle(late, 0) == ()
    assert scene.node.status().counters["stale"] == 1


def test_waiting_choice_outlives_the_process() -> None:
    scene = Scene()
    scene.choose("at", position_m=np.array([3.0, 0.0]), chooser="planner")
    node = build(TargetConfig())
    node.restore(scene.node.save(), 0)
    assert Scene(node).frame({1: (3, 0, RED)}).state == "locked"


def test_damaged_state_is_refused() -> None:
    with pytest.raises(DecodeError):
        build(TargetConfig()).restore(b"damaged", 0)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"action": "id"}, "id: expected a value with the action 'id'"),
        ({"action": "nearest", "id": 1}, "id: expected none with the action 'nearest'"),
        ({"action": "at"}, "position_m: expected a value"),
    ],
)
def test_command_without_its_value_is_refused(fields: dict[str, object], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        TargetCommand(stamp_ns=0, sequence=0, **fields)  # type: ignore[arg-type]
