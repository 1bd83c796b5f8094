"""Node: odometry, counted drops, and a tracker that uses the odometry."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from common.geometry.transforms import invert
from common.transport.memory_bus import MemoryBus
from people4d.messages import (
    F64,
    Detection,
    Detections,
    Message,
    MovingTransform,
    Odometry,
    RgbdFrame,
    Tracks,
)
from services.tracker.build import build as build_tracker
from services.tracker.config import TrackerConfig
from services.visual_odometry.build import build
from services.visual_odometry.config import VisualOdometryConfig
from services.visual_odometry.node import VisualOdometryNode
from tests import builders
from tests.visual_odometry.room import BASE_FROM_OPTICAL, FRAME_NS, INFO, base, view

MOUNT = builders.static_transform(BASE_FROM_OPTICAL, parent="base_link", child=INFO.frame_id)


def frame(pose: F64, number: int, **changed: object) -> RgbdFrame:
    image = view(pose, number)
    fields = {"stamp_ns": number * FRAME_NS, "sequence": number, "camera": "front"}
    return RgbdFrame(rgb=image.rgb, depth_mm=image.depth_mm, **(fields | changed))  # type: ignore[arg-type]


def node(config: VisualOdometryConfig | None = None) -> VisualOdometryNode:
    one = build(config or VisualOdometryConfig())
    for message in (INFO, MOUNT):
        assert not one.handle(message, 0)
    return one


def odometry_of(one: VisualOdometryNode, message: Message) -> Odometry | None:
    answers = one.handle(message, 0)
    assert len(answers) <= 1
    if not answers:
        return None
    assert isinstance(answers[0], Odometry)
    return answers[0]


def test_every_frame_is_answered_by_odometry_of_its_stamp() -> None:
    one = node()
    for number in range(4):
        pose = base(0.03 * number, 0.0, 0.02 * number)
        odometry = odometry_of(one, frame(pose, number))
        assert odometry is not None
        assert (odometry.stamp_ns, odometry.sequence) == (number * FRAME_NS, number)
        assert (odometry.frame_id, odometry.child_frame_id) == ("map", "base_link")
        assert odometry.x_m == pytest.approx(0.03 * number, abs=0.004)
        assert odometry.theta_rad == pytest.approx(0.02 * number, abs=0.004)
        assert odometry.covariance is not None
    assert one.status().state == "ready"
    assert one.status().counters["unanswered"] == 0


def test_odometry_is_in_odom_if_the_map_has_a_transform_to_it() -> None:
    one = node()
    one.handle(builders.static_transform(base(1.0), child="odom"), 0)
    odometry = odometry_of(one, frame(base(), 0))
    assert odometry is not None
    assert odometry.frame_id == "odom"


def test_motion_of_a_free_base_is_a_transform() -> None:
    one = node(VisualOdometryConfig(planar=False))
    (first,) = one.handle(frame(base(), 0), 0)
    (second,) = one.handle(frame(base(0.03), 1), 0)
    assert isinstance(first, MovingTransform)
    assert isinstance(second, MovingTransform)
    assert (second.parent, second.child) == ("map", "base_link")
    assert second.matrix[:3, 3] == pytest.approx([0.03, 0, 0], abs=0.004)


def test_duplicate_and_late_frames_are_counted() -> None:
    one = node()
    odometry_of(one, frame(base(), 5))
    assert odometry_of(one, frame(base(), 5)) is None
    assert odometry_of(one, frame(base(), 4)) is None
    assert one.status().counters["stale"] == 2
    assert odometry_of(one, frame(base(), 6)) is not None


def test_clock_reset_restarts_at_the_origin() -> None:
    """A recording loops: the base is at its first pose."""
    one = node()
    for number in range(3):
        odometry_of(one, frame(base(0.03 * number), 30 + number))
    again = odometry_of(one, frame(base(), 0))
    assert again is not None
    assert (again.x_m, again.theta_rad) == (0.0, 0.0)
    assert one.status().counters["clock_resets"] == 1


def test_missing_calibration_and_mounting_are_reported() -> None:
    one = build(VisualOdometryConfig())
    for number in range(6):
        assert odometry_of(one, frame(base(), number)) is None
    assert one.status().counters["no_camera_info"] == 6
    assert "no calibration of camera front" in one.status().reason
    one.handle(INFO, 0)
    assert odometry_of(one, frame(base(), 6)) is None
    assert one.status().counters["no_transform"] == 1
    assert "camera.mount_parent=base_link" in one.status().reason
    one.handle(MOUNT, 0)
    assert odometry_of(one, frame(base(), 7)) is not None
    assert one.status().state == "ready"


def test_images_of_another_size_are_counted() -> None:
    one = node()
    small = frame(base(), 0)
    small = replace(small, rgb=small.rgb[::2, ::2].copy(), depth_mm=small.depth_mm[::2, ::2].copy())
    assert odometry_of(one, small) is None
    assert one.status().counters["wrong_size"] == 1
    assert odometry_of(one, frame(base(), 1)) is not None


def test_pose_continues_after_a_change_of_calibration() -> None:
    one = node()
    odometry_of(one, frame(base(), 0))
    before = odometry_of(one, frame(base(0.05), 1))
    one.handle(replace(INFO, fx=INFO.fx * 1.001), 0)
    after = odometry_of(one, frame(base(0.05), 2))
    assert before is not None
    assert after is not None
    assert (after.x_m, after.theta_rad) == (before.x_m, before.theta_rad)
    assert one.status().counters["calibration_changes"] == 1


def test_frames_of_another_camera_are_ignored() -> None:
    one = node()
    odometry_of(one, frame(base(), 0))
    assert odometry_of(one, frame(base(0.1), 1, camera="rear")) is None
    assert one.status().counters["other_cameras"] == 1


def test_silent_if_another_process_publishes_odometry() -> None:
    """Own messages that the bus returns are no odometry of another process."""
    one = node()
    own = odometry_of(one, frame(base(), 0))
    assert own is not None
    one.handle(own, 0)
    assert odometry_of(one, frame(base(), 1)) is not None
    one.handle(replace(own, stamp_ns=FRAME_NS + 7, x_m=0.3), 0)
    assert odometry_of(one, frame(base(), 2)) is None
    assert one.status().state == "degraded"
    assert "another process publishes odometry of base_link" in one.status().reason


def test_a_white_wall_is_reported() -> None:
    one = node()
    for number in range(8):
        blank = frame(base(), number)
        one.handle(replace(blank, rgb=np.full_like(blank.rgb, 200)), 0)
    status = one.status()
    assert status.state == "degraded"
    assert "no texture" in status.reason
    assert status.counters["unanswered"] == 7


@pytest.mark.slow
def test_standing_person_before_a_turning_base_has_no_speed() -> None:
    """The track of a person at (3, 0.5) has no speed while the base turns."""
    bus = MemoryBus([node(), build_tracker(TrackerConfig(tracker="sort3d"))])
    bus.publish(INFO, MOUNT)
    person, speeds = np.array([3.0, 0.5, 1.0, 1.0]), []
    for number in range(30):
        pose = base(theta_rad=0.15 * (1 - math.cos(0.2 * number)))
        position = (invert(pose @ BASE_FROM_OPTICAL) @ person)[:3]
        published = bus.publish(frame(pose, number), found(position, number))
        for tracks in (m for m in published if isinstance(m, Tracks)):
            speeds += [float(np.linalg.norm(t.velocity_mps[:2])) for t in tracks.tracks]
    assert len(speeds) > 20
    assert max(speeds[10:]) < 0.05


def found(position_m: F64, number: int) -> Detections:
    u = INFO.fx * position_m[0] / position_m[2] + INFO.cx
    box = np.array([u - 20, 20, u + 20, 230], np.float32)
    person = Detection(box_xyxy_px=box, score=0.9, position_m=position_m)
    return builders.detections(
        person,
        stamp_ns=number * FRAME_NS,
        sequence=number,
        frame_id=INFO.frame_id,
        width=INFO.width,
        height=INFO.height,
    )
