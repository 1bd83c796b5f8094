"""The bridge: each message as decoded by its readers in ROS."""

import math
from typing import Any, get_args

import msgspec
import numpy as np
import pytest

from common.geometry.transforms import rotation_from_rpy, transform_from
from common.ros2 import types
from common.ros2.messages.basic import TF, transforms
from common.ros2.transport import LATCHED
from people4d.messages import Event, PersonSkeleton, Predictions, Skeletons, Span, Track
from people4d.messages.prediction import MotionProbabilities, PersonPrediction
from people4d.messages.skeleton import Posture
from services.ros2_bridge.config import Output, OutputConfigs, Ros2BridgeConfig
from services.ros2_bridge.node import Ros2BridgeNode
from tests import builders
from tests.ros2_bridge.memory import MemoryTransport

MS = 1_000_000
START_NS = 1_700_000_000 * 10**9
EVERYTHING = Ros2BridgeConfig(publish=get_args(Output))


def bridge(config: Ros2BridgeConfig, wall_ns: int = START_NS) -> tuple[Ros2BridgeNode, Any]:
    transport = MemoryTransport(config.ros2)
    return Ros2BridgeNode(config, transport, lambda: wall_ns), transport


def person(id_: int = 7, x_m: float = 2.0, **fields: Any) -> Track:
    covariance = np.diag([0.04, 0.01, 0.02, 0.1, 0.2, 0.3])
    covariance[0, 1] = covariance[1, 0] = 0.005
    given = {
        "id": id_,
        "position_m": np.array([x_m, -1.0, 1.2]),
        "velocity_mps": np.array([0.0, 1.5, 0.0]),
        "covariance": covariance,
        "yaw_rad": 0.5,
        "score": 0.75,
        "detection": 0,
    }
    return builders.track(**(given | fields))


def people(*tracks: Track, at_ms: int = 0) -> Any:
    return builders.tracks(*tracks, stamp_ns=START_NS + at_ms * MS, camera="front")


def prediction(**groups: int) -> Predictions:
    futures = tuple(
        PersonPrediction(
            id=int(name[1:]),
            state="confirmed",
            position_m=np.array([2.0, -1.0, 1.2]),
            velocity_mps=np.array([0.0, 1.5]),
            motion=MotionProbabilities(standing=0.0, going_on=1.0, turning=0.0),
            means_m=np.array([[2.0, -0.25], [2.0, 0.5]]),
            covariances_m2=np.array([np.diag([0.09, 0.04]), np.diag([0.16, 0.09])]),
            group=group or None,
        )
        for name, group in groups.items()
    )
    return Predictions(
        stamp_ns=START_NS,
        sequence=0,
        frame_id="map",
        camera="front",
        horizons_s=(0.5, 1.0),
        people=futures,
    )


def tf(parent: str, child: str, at_ms: int | None) -> bytes:
    stamp_ns = 0 if at_ms is None else START_NS + at_ms * MS
    return types.encode(TF, transforms([(parent, child, np.eye(4))], stamp_ns))


def stamp_of(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def test_only_people_and_markers_are_published_unless_asked_for() -> None:
    _, ros = bridge(Ros2BridgeConfig())
    assert set(ros.topics) == {"/people", "/people4d/markers"}
    assert not ros.subscriptions


def test_people_in_the_convention_nav2() -> None:
    node, ros = bridge(Ros2BridgeConfig())
    node.handle(people(person()), 0)
    message = ros.last("/people")
    assert (stamp_of(message), message.header.frame_id) == (START_NS, "map")
    (one,) = message.people
    assert (one.position.x, one.position.y) == (2.0, -1.0)
    assert (one.velocity.x, one.velocity.y, one.velocity.z) == (0.0, 1.5, 0.0)
    assert (one.name, one.reliability) == ("7", 0.75)
    assert list(zip(one.tagnames, one.tags, strict=True)) == [
        *(("id", "7"), ("group", "-1"), ("state", "confirmed"), ("yaw_rad", "0.5")),
    ]


def test_people_in_the_convention_sfm() -> None:
    node, ros = bridge(Ros2BridgeConfig(convention="sfm"))
    for k in range(60):  # turns by 0.5 rad/s
        node.handle(people(person(yaw_rad=0.5 + 0.5 * 0.05 * k), at_ms=50 * k), 0)
    (one,) = ros.last("/people").people
    assert one.position.z == pytest.approx(0.5 + 0.5 * 0.05 * 59)
    assert one.velocity.z == pytest.approx(0.5, abs=0.01)


def test_group_is_that_of_the_last_predictions() -> None:
    node, ros = bridge(Ros2BridgeConfig())
    node.handle(prediction(p7=3, p8=0), 0)
    node.handle(people(person(7), person(8), at_ms=100), 0)
    assert [one.tags[1] for one in ros.last("/people").people] == ["3", "-1"]
    node.handle(people(person(7), at_ms=1500), 0)
    assert ros.last("/people").people[0].tags[1] == "-1"


def test_direction_of_walking_is_the_yaw_where_none_is_known() -> None:
    node, ros = bridge(Ros2BridgeConfig(convention="sfm"))
    node.handle(people(person(yaw_rad=None), person(8, yaw_rad=None, velocity_mps=np.zeros(3))), 0)
    walks, stands = ros.last("/people").people
    assert (walks.position.z, stands.position.z) == (math.pi / 2, 0.0)


def test_planners_get_pose_twist_and_covariance() -> None:
    node, ros = bridge(Ros2BridgeConfig(publish=("agents", "tracked_persons", "pedestrians")))
    node.handle(people(person(70)), 0)
    node.handle(people(person(70), at_ms=2500), 0)
    (agent,) = ros.last("/tracked_agents").agents
    (segment,) = agent.segments
    assert (agent.track_id, agent.type, agent.state, agent.name) == (1, 1, 1, "human70")
    assert segment.type == 1
    (tracked,) = ros.last("/spencer/perception/tracked_persons").tracks
    assert (tracked.track_id, tracked.is_matched, tracked.is_occluded) == (70, True, False)
    assert (tracked.age.sec, tracked.age.nanosec) == (2, 500 * MS)
    for motion in (segment, tracked):
        pose, twist = motion.pose.pose, motion.twist.twist
        assert (pose.position.x, pose.position.z, twist.linear.y) == (2.0, 1.2, 1.5)
        assert 2 * math.atan2(pose.orientation.z, pose.orientation.w) == pytest.approx(0.5)
        assert motion.pose.covariance.reshape(6, 6)[0, 1] == 0.005
        assert motion.twist.covariance.reshape(6, 6)[2, 2] == 0.3
    assert tracked.pose.covariance.reshape(6, 6)[3, 3] > 99999
    (pedestrian,) = ros.last("/pedestrians").pedestrians
    assert pedestrian.pedestrian.identifier == "70"
    assert pedestrian.pedestrian.pose.theta == 0.5
    assert pedestrian.pedestrian.velocity.y == 1.5
    np.testing.assert_allclose(pedestrian.covariance, [0.04, 0.005, 0.005, 0.01])


def test_agents_are_numbered_in_a_row_and_hold_their_numbers() -> None:
    node, ros = bridge(Ros2BridgeConfig(publish=("agents",)))

    def numbers(*ids: int) -> dict[str, int]:
        node.handle(people(*map(person, ids)), 0)
        return {agent.name[5:]: agent.track_id for agent in ros.last("/tracked_agents").agents}

    assert numbers(70, 12, 9) == {"70": 1, "12": 2, "9": 3}
    assert numbers(9, 12) == {"12": 2, "9": 1}  # 1 to 2, and 12 holds its number
    assert numbers(12, 5, 9) == {"12": 2, "5": 3, "9": 1}


def test_boxes_stand_on_the_floor() -> None:
    node, ros = bridge(Ros2BridgeConfig(publish=("boxes",), box_m=(0.4, 0.6, 1.8)))
    node.handle(people(person()), 0)
    (box,) = ros.last("/people4d/boxes").detections
    assert (box.id, box.bbox.center.position.z, box.bbox.size.z) == ("7", 0.9, 1.8)
    (result,) = box.results
    assert (result.hypothesis.class_id, result.hypothesis.score) == ("person", 0.75)
    assert result.pose.covariance[7] == 0.01


def test_markers_show_box_heading_speed_id_and_ellipse() -> None:
    node, ros = bridge(Ros2BridgeConfig())
    node.handle(people(person()), 0)
    markers = {marker.ns: marker for marker in ros.last("/people4d/markers").markers}
    assert set(markers) == {"box", "heading", "velocity", "id", "covariance"}
    assert (markers["id"].text, markers["id"].id) == ("7", 7)
    assert markers["velocity"].scale.x == 1.5
    # 90 % of a plane's normal distribution: 2.146 standard deviations each way; det = 0.000375
    scale = markers["covariance"].scale
    assert scale.x * scale.y == pytest.approx(4 * 2.146**2 * math.sqrt(0.04 * 0.01 - 0.005**2))
    assert all(one.lifetime.nanosec == 500 * MS for one in markers.values())


def test_predictions_are_drawn_as_a_path_with_ellipses() -> None:
    node, ros = bridge(Ros2BridgeConfig(publish=("prediction_markers",)))
    node.handle(prediction(p7=0), 0)
    path, first, second = ros.last("/people4d/prediction_markers").markers
    points = [(point.x, point.y) for point in path.points]
    assert points == [(2.0, -1.0), (2.0, -0.25), (2.0, 0.5)]
    assert first.scale.x == pytest.approx(2 * 2.146 * 0.3)
    assert (second.pose.position.y, second.ns) == (0.5, "predicted_2")


def test_skeleton_has_eighteen_points_with_a_neck() -> None:
    keypoints = np.zeros((17, 3), np.float32)
    keypoints[5], keypoints[6] = (100, 50, 0.75), (140, 70, 0.5)  # shoulders, left first
    keypoints[0] = (900, 50, 0.9)  # outside the image
    detection = builders.detection(
        box_xyxy_px=np.array([-10, 20, 320, 260], np.float32), keypoints=keypoints
    )
    found = builders.detections(detection, stamp_ns=START_NS, camera="front", width=640, height=480)
    node, ros = bridge(Ros2BridgeConfig(publish=("humans", "tf")))
    node.handle(found, 0)
    node.handle(people(person()), 0)
    assert ros.last("/humans/bodies/tracked").ids == ["b00007"]
    assert ros.last("/humans/persons/tracked").ids == ["p00007"]
    assert ros.last("/humans/persons/p00007/body_id").data == "b00007"
    assert ros.topics["/humans/persons/p00007/body_id"].qos == LATCHED
    region = ros.last("/humans/bodies/b00007/roi")
    assert (region.xmin, region.xmax) == (0.0, 0.5)
    skeleton = ros.last("/humans/bodies/b00007/skeleton2d").skeleton
    assert len(skeleton) == 18
    nose, neck, right = skeleton[:3]
    assert nose.c == 0.0
    assert (neck.x, neck.y, neck.c) == (pytest.approx(120 / 640), 60 / 480, 0.5)
    assert (right.x, right.c) == (pytest.approx(140 / 640), 0.5)
    (body,) = ros.last("/tf").transforms
    assert (body.header.frame_id, body.child_frame_id) == ("map", "body_b00007")
    node.handle(people(at_ms=33), 0)
    assert ros.topics["/humans/bodies/b00007/roi"].closed
    assert ros.last("/humans/bodies/tracked").ids == []


def raising(posture: Posture, wrist: int) -> Skeletons:
    positions_m = np.zeros((17, 3), np.float32)
    positions_m[wrist, 2] = 2.0
    body = PersonSkeleton(
        id=7,
        state="confirmed",
        positions_m=positions_m,
        covariances_m2=np.tile(np.eye(3, dtype=np.float32), (17, 1, 1)),
        measured=(True,) * 17,
        posture=posture,
        object_like=0.75,
    )
    return Skeletons(stamp_ns=START_NS, sequence=0, frame_id="map", camera="front", people=(body,))


@pytest.mark.parametrize(
    ("posture", "number"), [("walking", 1), ("sitting", 2), ("lying", 4), ("bending", 0)]
)
def test_posture_of_a_body_is_published(posture: Posture, number: int) -> None:
    node, ros = bridge(Ros2BridgeConfig(publish=("humans",)))
    node.handle(people(person()), 0)
    node.handle(raising(posture, 9), 0)
    found = ros.last("/humans/bodies/b00007/posture")
    assert (found.posture, stamp_of(found)) == (number, START_NS)
    assert ros.last("/humans/bodies/b00007/object_like").data == 0.75


def test_joint_states_turn_with_the_body_and_urdf_follows_its_bones() -> None:
    node, ros = bridge(Ros2BridgeConfig(publish=("humans",)))
    node.handle(people(person(yaw_rad=math.pi / 2)), 0)
    message = raising("standing", 9)
    joints_m = np.zeros((17, 3), np.float32)  # the body faces +y, its left is -x
    joints_m[[5, 11], 0], joints_m[[6, 12], 0] = -0.2, 0.2
    joints_m[[5, 6], 2] = 0.5
    joints_m[[7, 8]] = joints_m[[5, 6]] + (0.0, 0.3, 0.0)  # arms forward
    joints_m[[9, 10]] = joints_m[[7, 8]] + (0.0, 0.25, 0.0)
    joints_m[[13, 14]] = joints_m[[11, 12]] - (0.0, 0.0, 0.4)
    joints_m[[15, 16]] = joints_m[[13, 14]] - (0.0, 0.0, 0.4)
    body = msgspec.structs.replace(message.people[0], positions_m=joints_m)
    node.handle(msgspec.structs.replace(message, people=(body,)), 0)
    found = ros.last("/humans/bodies/b00007/joint_states")
    angles = dict(zip(found.name, found.position, strict=True))
    assert angles["waist_b00007"] == pytest.approx(0.0)
    assert angles["l_p_shoulder_b00007"] == pytest.approx(math.pi / 2)
    assert angles["r_y_shoulder_b00007"] == pytest.approx(math.pi / 2, abs=1e-6)
    assert angles["l_r_hip_b00007"] == pytest.approx(0.0, abs=1e-6)
    assert ros.topics["/humans/bodies/b00007/urdf"].qos == LATCHED
    assert 'xyz="0.0 0.0 -0.3"' in ros.last("/humans/bodies/b00007/urdf").data  # elbow
    for k, (scale, measured) in enumerate([(1.05, True), (2.0, False), (1.3, True)], 1):
        taller = msgspec.structs.replace(
            body, positions_m=scale * joints_m, measured=(measured,) * 17
        )
        node.handle(msgspec.structs.replace(message, stamp_ns=START_NS + k, people=(taller,)), 0)
        # the mean torso is 0.5125 m, without hidden joints the same, then 0.558 m
        assert len(ros.messages("/humans/bodies/b00007/urdf")) == (1, 1, 2)[k - 1]


def test_engagement_of_a_person_is_published() -> None:
    node, ros = bridge(Ros2BridgeConfig(publish=("humans",)))
    node.handle(people(person(yaw_rad=2.7)), 0)  # the robot is unknown
    assert ros.last("/humans/persons/p00007/engagement_status").level == 0
    node.handle(builders.static_transform(np.eye(4), "base_link"), 0)
    node.handle(people(person(yaw_rad=2.7), at_ms=33), 0)
    assert ros.last("/humans/persons/p00007/engagement_status").level == 2


@pytest.mark.parametrize(
    ("kind", "wrist", "gestures"),
    [("raised_hand", 9, [3]), ("raised_hand", 10, [4]), ("waved", 9, [6]), ("fell", 9, [])],
)
def test_gesture_of_an_event_is_published(kind: Any, wrist: int, gestures: list[int]) -> None:
    node, ros = bridge(Ros2BridgeConfig(publish=("humans",)))
    node.handle(people(person()), 0)
    node.handle(raising("standing", wrist), 0)
    node.handle(Event(stamp_ns=START_NS, sequence=0, kind=kind, id=7), 0)
    node.handle(Event(stamp_ns=START_NS, sequence=1, kind=kind, id=8), 0)
    assert [one.gesture for one in ros.messages("/humans/bodies/b00007/gesture")] == gestures


def test_motion_and_confidence_of_people_are_published() -> None:
    node, ros = bridge(Ros2BridgeConfig(publish=("humans",)))
    node.handle(people(person()), 0)
    point = ros.last("/humans/bodies/b00007/position").point
    assert (point.x, point.y, point.z) == (2.0, -1.0, 1.2)
    assert ros.last("/humans/bodies/b00007/velocity").twist.linear.y == 1.5
    assert ros.last("/humans/persons/p00007/anonymous").data is True
    assert ros.last("/humans/persons/p00007/location_confidence").data == 1.0
    node.handle(people(person(state="lost", detection=None), at_ms=33), 0)
    assert ros.last("/humans/persons/p00007/location_confidence").data == 0.0


def test_motion_is_published_as_odometry_and_transforms() -> None:
    node, ros = bridge(
        Ros2BridgeConfig(publish=("odometry", "tf"), frame_names={"odom": "robot1/odom"})
    )
    node.handle(builders.odometry(stamp_ns=START_NS, x_m=1.0, theta_rad=0.5), 0)
    odometry = ros.last("/people4d/odometry")
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("robot1/odom", "base_link")
    (edge,) = ros.last("/tf").transforms
    assert (edge.header.frame_id, edge.transform.translation.x) == ("robot1/odom", 1.0)
    for child in ("camera_link", "other_link"):
        node.handle(builders.static_transform(np.eye(4), parent="base_link", child=child), 0)
    assert [one.child_frame_id for one in ros.last("/tf_static").transforms] == [
        *("camera_link", "other_link"),
    ]
    assert ros.topics["/tf_static"].qos == LATCHED


def test_health_becomes_diagnostics_and_a_silent_process_stale() -> None:
    node, ros = bridge(Ros2BridgeConfig(publish=("diagnostics",)))
    node.handle(builders.health(instance="tracker-1", state="ready", counters={"a": 3}), 0)
    node.tick(0)
    (status,) = ros.last("/diagnostics").status
    assert (status.level, status.name, status.values[0].value) == (0, "people4d: tracker-1", "3")
    assert node.wake_ns() == 1000 * MS
    node.tick(100 * MS)
    assert len(ros.messages("/diagnostics")) == 1
    node.tick(4000 * MS)
    assert ros.last("/diagnostics").status[0].level == 3


def test_rate_leaves_messages_out() -> None:
    outputs = msgspec.convert({"people": {"topic": "seen", "rate_max_hz": 10.0}}, OutputConfigs)
    node, ros = bridge(Ros2BridgeConfig(publish=("people",), outputs=outputs))
    for k in range(30):
        node.handle(people(person(), at_ms=33 * k), 0)
    assert len(ros.messages("/seen")) in range(8, 12)


def test_people_are_brought_to_a_frame() -> None:
    node, ros = bridge(Ros2BridgeConfig(frame_id="base_link", publish=("people", "boxes")))
    node.handle(people(person()), 0)
    assert not ros.messages("/people")
    assert node.status().counters["unknown_frame"] == 1
    assert node.status().reason == "no transform leads from map to base_link"
    turned = transform_from((1.0, 0.0, 0.0), rotation_from_rpy(0.0, 0.0, math.pi / 2))
    node.handle(builders.static_transform(turned, parent="map", child="base_link"), 0)
    node.handle(people(person()), 0)
    (one,) = ros.last("/people").people
    assert ros.last("/people").header.frame_id == "base_link"
    # (2, -1) from (1, 0), turned back by a quarter
    assert (one.position.x, one.position.y) == (pytest.approx(-1.0), pytest.approx(-1.0))
    assert (one.velocity.x, one.velocity.y) == (pytest.approx(1.5), pytest.approx(0.0))
    covariance = ros.last("/people4d/boxes").detections[0].results[0].pose.covariance
    assert covariance[0] == pytest.approx(0.01)


def test_people_are_moved_on_to_the_time_of_sending() -> None:
    node, ros = bridge(Ros2BridgeConfig(stamps="sent"), START_NS + 200 * MS)
    node.handle(people(person()), 0)
    message = ros.last("/people")
    assert stamp_of(message) == START_NS + 200 * MS
    assert message.people[0].position.y == pytest.approx(-1.0 + 0.3)


@pytest.mark.parametrize("months", [-4, 4])
def test_people_of_a_recording_are_published_where_they_are(months: int) -> None:
    """The stamps are months off; 200 ms pass between the source and the bridge."""
    apart_ms = months * 30 * 24 * 3600 * 1000
    config = Ros2BridgeConfig(publish=("people", "tf", "prediction_markers"), stamps="sent")
    node, ros = bridge(config, START_NS + 200 * MS)
    sent = Span(stage="camera.release", process="c@h", start_ns=START_NS, end_ns=START_NS + 1)
    tracks = msgspec.structs.replace(people(person(), at_ms=apart_ms), trace=(sent,))
    node.handle(tracks, 0)
    message = ros.last("/people")
    assert stamp_of(message) == START_NS + 200 * MS
    assert message.people[0].position.y == pytest.approx(-1.0 + 0.3)
    moving = builders.moving_transform(np.eye(4), stamp_ns=tracks.stamp_ns + 10 * MS)
    node.handle(moving, 0)
    assert stamp_of(ros.last("/tf").transforms[0]) == START_NS + 10 * MS
    node.handle(msgspec.structs.replace(prediction(p7=0), stamp_ns=tracks.stamp_ns), 0)
    assert stamp_of(ros.last("/people4d/prediction_markers").markers[-1]) == START_NS


@pytest.mark.parametrize(("late_ms", "where"), [(501, "behind"), (9000, "behind"), (-501, "ahead")])
def test_people_are_not_moved_over_more_than_half_a_second(late_ms: int, where: str) -> None:
    node, ros = bridge(Ros2BridgeConfig(stamps="sent"), START_NS + late_ms * MS)
    node.handle(people(person(7), person(8)), 0)
    assert not ros.messages("/people")
    status = node.status()
    assert (status.state, status.counters["not_extrapolated"]) == ("degraded", 2)
    assert where in status.reason
    node.handle(people(person(), at_ms=late_ms - 10), 0)
    assert len(ros.messages("/people")) == 1
    assert node.status().state == "ready"


def test_people_are_not_moved_back_to_old_transforms_of_their_reader() -> None:
    node, ros = bridge(Ros2BridgeConfig(reader_frame="odom", reader_wait_s=0.05))
    ros.send("/tf", tf("map", "odom", -600))
    node.handle(people(person()), 0)
    node.tick(50 * MS)
    assert not ros.messages("/people")
    assert node.status().counters["not_extrapolated"] == 1


def test_clock_is_the_time_of_the_recording() -> None:
    node, ros = bridge(Ros2BridgeConfig(publish=("people", "clock")), START_NS + 200 * MS)
    sent = Span(stage="camera.release", process="c@h", start_ns=START_NS, end_ns=START_NS + 1)
    tracks = people(person(), at_ms=-3_600_000)
    node.handle(msgspec.structs.replace(tracks, trace=(sent,)), 0)
    clock = ros.last("/clock").clock
    assert clock.sec * 10**9 + clock.nanosec == tracks.stamp_ns + 200 * MS
    assert stamp_of(ros.last("/people")) == tracks.stamp_ns
    assert not node.status().gauges


def test_distance_of_stamps_from_the_wall_clock_is_reported() -> None:
    node, _ = bridge(Ros2BridgeConfig(), START_NS)
    node.handle(people(person(), at_ms=-3_600_000), 0)
    assert node.status().gauges == {"stamps_behind_s": 3600.0}


def test_people_wait_for_the_transform_of_their_reader() -> None:
    node, ros = bridge(Ros2BridgeConfig(reader_frame="odom"))
    ros.send("/tf", tf("map", "odom", -20))
    node.handle(people(person()), 0)
    assert not ros.messages("/people")
    ros.send("/tf", tf("map", "odom", 10))
    node.tick(1)
    assert stamp_of(ros.last("/people")) == START_NS


def test_people_are_moved_to_the_last_time_that_their_reader_has() -> None:
    node, ros = bridge(Ros2BridgeConfig(reader_frame="odom", reader_wait_s=0.05))
    ros.send("/tf", tf("map", "odom", -20))
    node.handle(people(person()), 0)
    assert node.wake_ns() == 50 * MS
    node.tick(50 * MS)
    message = ros.last("/people")
    assert stamp_of(message) == START_NS - 20 * MS
    assert message.people[0].position.y == pytest.approx(-1.0 - 0.02 * 1.5)
    assert node.status().counters["reader_restamped"] == 1


def test_reader_without_transforms_is_reported() -> None:
    node, ros = bridge(Ros2BridgeConfig(reader_frame="odom"))
    ros.send("/tf", tf("odom", "base_link", 0))
    node.handle(people(person()), 0)
    node.tick(200 * MS)
    status = node.status()
    assert (status.state, status.counters["reader_unlinked"]) == ("degraded", 1)
    assert "odom" in status.reason
    ros.send("/tf_static", tf("map", "odom", None))
    node.handle(people(person()), 0)
    assert node.status().state == "ready"


def test_bad_transforms_are_counted() -> None:
    node, ros = bridge(Ros2BridgeConfig(reader_frame="base_link"))
    ros.send("/tf", tf("map", "odom", 10))
    ros.send("/tf", tf("odom", "base_link", 10))
    ros.send("/tf", tf("base_link", "map", 10))  # a loop
    ros.send("/tf", tf("base_link", "base_link", 10))
    ros.send("/tf", tf("", "base_link", 10))
    ros.send("/tf", b"no CDR")
    zero = {"transforms": [{"transform": {"rotation": {"w": 0.0}}}]}
    ros.send("/tf", types.encode(TF, zero))
    node.handle(people(person()), 0)
    assert len(ros.messages("/people")) == 1
    counters = node.status().counters
    assert (counters["tf_loops"], counters["tf_bad"], counters["bad_message"]) == (2, 2, 1)


def test_closing_leaves_the_graph() -> None:
    node, ros = bridge(EVERYTHING)
    node.close()
    assert ros.closed
