"""Yaw of tracks: by the velocity, in trackers, and through the node."""

import math
from typing import Any, Literal

import numpy as np
import pytest

from common.config import load
from common.geometry.transforms import LINK_FROM_OPTICAL, rotation_from_rpy, transform_from, wrap
from people4d.errors import ConfigError
from people4d.messages import Detection, Message, Track, Tracks
from services.tracker.build import build, make_tracker
from services.tracker.config import TrackerConfig
from services.tracker.interface import Measurement
from services.tracker.motion.yaw import VelocityYaw
from services.tracker.motion.yaw_sources import make_yaw
from services.tracker.observe import yaw_of
from tests import builders
from tests.tracker.scene import AT_REST, FRAME_NS, facing, frame, published, published_config

# The velocity


def test_yaw_of_the_velocity() -> None:
    by_velocity = VelocityYaw(0.2)
    assert by_velocity.read(None, np.array([0.0, -1.0, 5.0])) == pytest.approx(-math.pi / 2)
    assert by_velocity.read(None, np.array([-1.0, -0.0, 0.0])) == math.pi  # wrapped to (-pi, pi]
    assert by_velocity.read(None, np.array([0.1, 0.1, 5.0])) is None
    everyone = VelocityYaw(0.0)
    assert everyone.read(None, np.array([1e-3, 1e-3, 0.0])) == pytest.approx(math.pi / 4)
    assert everyone.read(None, AT_REST) is None


def test_yaw_can_be_left_out() -> None:
    assert make_yaw("none", 0.2).read(None, np.ones(3)) is None


# In a tracker


@pytest.mark.parametrize("source", ["keypoints", "kalman"])
@pytest.mark.parametrize("name", ["sort3d", "strongsort3d"])
def test_life_cycle_in_a_tracker(name: str, source: Literal["keypoints", "kalman"]) -> None:
    tracker = make_tracker(published_config(tracker=name, yaw=source))

    results: list[Track] = []

    def yaw_deg(*detected: Measurement) -> float:
        results.extend(tracker.update(frame(len(results), *detected)))
        yaw_rad = results[-1].yaw_rad
        return math.nan if yaw_rad is None else math.degrees(yaw_rad) % 360

    assert math.isnan(yaw_deg(facing(None)))  # a track without a yaw
    assert yaw_deg(facing(math.radians(170))) == pytest.approx(170, abs=1)  # begins
    assert 170 < yaw_deg(facing(math.radians(-170))) < 190  # across 180 deg
    for turned_deg in range(-170, 0, 6):  # 60 deg/s
        last_deg = yaw_deg(facing(math.radians(turned_deg)))
    assert last_deg == pytest.approx(turned_deg % 360, abs=5)
    # After a missed frame the predicted yaw is 6 deg farther. A detection without a yaw adds 6 deg.
    (ahead,) = tracker.predict(len(results) * FRAME_NS)
    assert ahead.yaw_rad is not None
    assert ahead.yaw_rad == pytest.approx(math.radians(last_deg + 6 - 360), abs=0.06)
    assert yaw_deg() == pytest.approx(math.degrees(ahead.yaw_rad) % 360)
    assert yaw_deg(facing(None)) == pytest.approx((last_deg + 12) % 360, abs=6)
    tracker.reset()
    assert math.isnan(yaw_deg(facing(None)))


def test_new_person_does_not_inherit_an_identity() -> None:
    tracker = make_tracker(published_config(yaw="keypoints"))
    tracker.update(frame(0, facing(1.0, x=3.0, y=1.0)))
    tracks = tracker.update(frame(1, facing(1.0, x=3.0, y=1.0), facing(-2.0, x=4.0, y=-1.0)))
    assert [track.yaw_rad for track in tracks] == pytest.approx([1.0, -2.0], abs=0.02)


# From the message to the map


def tracks_of(map_from_camera: Any, heading: Any, **fields: Any) -> list[Track]:
    config = published_config(embedding_wait_s=0.0, strongsort3d=published(n_init=1), **fields)
    node = build(config)
    detection = Detection(
        box_xyxy_px=np.array([300, 100, 400, 400], np.float32),
        score=0.9,
        position_m=np.array([0.0, 0.0, 3.0]),
        heading=heading,
        heading_sigma_rad=None if heading is None else 0.2,
    )
    sent: list[Message] = [
        builders.static_transform(map_from_camera, child="optical"),
        builders.detections(detection, stamp_ns=1, frame_id="optical"),
    ]
    (results,) = [answer for message in sent for answer in node.handle(message, 0)]
    assert isinstance(results, Tracks)
    return list(results.tracks)


@pytest.mark.parametrize(
    ("turned_deg", "heading", "expected_deg"),
    [
        (0, (0, 0, 1), 0),  # away from a camera that looks along the map's x
        (0, (-1, 0, 0), 90),  # its image-left is the map's y
        (90, (0, 0, -1), -90),  # towards a camera that looks along y
        (90, (-1, 0, 0), 180),  # image-left of a camera that looks along y is -x
        (-135, (1, 0, 0), 135),  # image-right of a camera at -135 is -135 - 90 = -225 = 135
    ],
)
def test_the_yaw_of_a_track_is_in_the_map(
    turned_deg: float, heading: tuple[float, float, float], expected_deg: float
) -> None:
    for roll, pitch in ((0.0, 0.0), (0.0, 0.5), (0.2, -0.3)):  # a level, a nodding, a leaning one
        link = rotation_from_rpy(0, 0, math.radians(turned_deg))
        # Tilt turns camera and heading equally: what the camera sees of a level person changes.
        tilt = rotation_from_rpy(roll, pitch, 0)
        matrix = transform_from([5.0, -2.0, 1.2], link @ tilt @ LINK_FROM_OPTICAL[:3, :3])
        level = LINK_FROM_OPTICAL[:3, :3].T @ tilt.T @ LINK_FROM_OPTICAL[:3, :3] @ heading
        (track,) = tracks_of(matrix, level, yaw="keypoints")
        assert track.yaw_rad is not None
        assert wrap(track.yaw_rad - math.radians(expected_deg)) == pytest.approx(0.0, abs=0.02)


def test_other_sources_leave_the_heading_alone() -> None:
    matrix, ahead = transform_from(np.zeros(3), LINK_FROM_OPTICAL[:3, :3]), np.array([0, 0, 1.0])
    assert tracks_of(matrix, ahead, yaw="keypoints")[0].yaw_rad == pytest.approx(0.0)
    for source in ("velocity", "none"):
        assert tracks_of(matrix, ahead, yaw=source)[0].yaw_rad is None  # at rest
    assert tracks_of(matrix, None, yaw="keypoints")[0].yaw_rad is None


def test_a_heading_straight_up_has_no_yaw() -> None:
    # A camera that looks straight down: its forward is the map's -z.
    down = transform_from(
        np.zeros(3), rotation_from_rpy(0, math.pi / 2, 0) @ LINK_FROM_OPTICAL[:3, :3]
    )
    assert yaw_of(np.array([0.0, 0.0, 1.0]), down) is None
    # Image-left of it is still level: the map's y.
    assert yaw_of(np.array([-1.0, 0.0, 0.0]), down) == pytest.approx(math.pi / 2)


def test_unknown_source_is_rejected() -> None:
    with pytest.raises(ConfigError, match="yaw"):
        load(TrackerConfig, "tracker", None, ["yaw=nose"], {})
