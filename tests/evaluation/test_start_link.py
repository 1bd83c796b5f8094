"""Recordings of a moving camera without a transform to the frame of the tracks."""

import math

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from
from evaluation.recordings.ground_truth import SampledTruth, TruthFrame
from evaluation.run.start_link import with_start_link
from people4d.errors import SourceError
from people4d.messages import F64, Message, StaticTransform
from tests import builders
from tests.evaluation.builders import INFO, STEP_NS, detections

MOUNTED = builders.static_transform(LINK_FROM_OPTICAL, parent="base_link", child=INFO.frame_id)


def base(x_m: float, y_m: float, yaw_rad: float) -> F64:
    return transform_from([x_m, y_m, 0.0], rotation_from_rpy(0.0, 0.0, yaw_rad))


def driven(*extra: Message) -> list[Message]:
    """Two frames of a robot that drives 0.5 m ahead, by odometry from (1, 0)."""
    poses = [
        builders.odometry(stamp_ns=k * STEP_NS, frame_id="odom", x_m=1 + 0.5 * k) for k in (0, 1)
    ]
    return [INFO, MOUNTED, *extra, poses[0], detections(0), poses[1], detections(1)]


def truth(*poses: F64 | None, frame_id: str = "map") -> SampledTruth:
    frames = tuple(TruthFrame((), frozenset(), {}, pose) for pose in poses)
    return SampledTruth(frame_id, (), frames)


def test_true_pose_of_the_camera_links_odometry_to_the_map() -> None:
    # Odometry says (1.5, 0) facing x in the second frame, the first whose true pose is known:
    # (2, 3) facing y. Its origin is 1.5 m behind that: (2, 1.5), turned by 90 deg.
    true = truth(None, base(2.0, 3.0, math.pi / 2) @ LINK_FROM_OPTICAL)
    messages = with_start_link(driven(), true, INFO, "map", "robot.mcap")
    link = messages[0]
    assert isinstance(link, StaticTransform)
    assert (link.parent, link.child) == ("map", "odom")
    np.testing.assert_allclose(link.matrix, base(2.0, 1.5, math.pi / 2), atol=1e-12)
    assert messages[1:] == driven()


def test_recorded_link_is_used_as_it_is() -> None:
    recorded = driven(builders.static_transform(base(9, 0, 0), parent="map", child="odom"))
    true = truth(base(2.0, 3.0, 0.0) @ LINK_FROM_OPTICAL, None)
    assert with_start_link(recorded, true, INFO, "map", "robot.mcap") == recorded


def test_standing_camera_needs_no_link() -> None:
    still: list[Message] = [INFO, detections(0), detections(1)]
    assert with_start_link(still, truth(None, None), INFO, "map", "still.mcap") == still


def test_unknown_pose_of_a_moving_camera_is_refused() -> None:
    with pytest.raises(
        SourceError, match=r"robot\.mcap has odometry, but no transform from map to"
    ):
        with_start_link(driven(), truth(None, None), INFO, "map", "robot.mcap")
    other = truth(base(0, 0, 0) @ LINK_FROM_OPTICAL, None, frame_id="vicon")
    with pytest.raises(SourceError, match="no transform from map to odom"):
        with_start_link(driven(), other, INFO, "map", "robot.mcap")
    loose = [message for message in driven() if message is not MOUNTED]
    with pytest.raises(SourceError, match="no transform leads from"):
        with_start_link(loose, truth(None, None), INFO, "map", "robot.mcap")
