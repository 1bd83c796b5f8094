import math
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from common.geometry.transforms import wrap
from lab.catalogue import load_scenario
from lab.scenario import CapturePlan, Scenario
from lab.source import LabTruth
from lab.truth.motion_capture import capture, capture_truth
from lab.world import EPOCH_NS, World
from people4d.errors import ConfigError
from people4d.messages import Truth
from services.gt_bridge.config import GtBridgeConfig
from services.gt_bridge.sources.registry import open_truth
from tests.lab.worlds import world


def scenario(name: str, **changes: object) -> Scenario:
    """Return a scenario with another plan of its capture."""
    return replace(load_scenario(name), capture=CapturePlan(**changes))  # type: ignore[arg-type]


def test_samples_have_the_rate_of_the_system() -> None:
    # 3 s at 100 Hz, both ends included
    messages = list(capture_truth(world("short_walk")))
    assert len(messages) == 301
    assert [message.sequence for message in messages] == list(range(301))
    assert messages[0].stamp_ns == EPOCH_NS
    assert {b.stamp_ns - a.stamp_ns for a, b in pairwise(messages)} == {10_000_000}
    assert {message.frame_id for message in messages} == {"map"}


def test_the_position_is_the_mean_of_shoulders_and_hips() -> None:
    of = world("facing")
    keypoints = of.bodies[1].keypoints_m(of.poses(0.4)[1])
    expected = (keypoints[5] + keypoints[6] + keypoints[11] + keypoints[12]) / 4
    np.testing.assert_allclose(capture(of, 1, 0.4).position_m, expected, atol=1e-12)
    # She stands at (3.8, -0.7); the torso is above the feet, between hip and shoulder.
    assert np.hypot(*(expected[:2] - (3.8, -0.7))) < 0.05
    assert 0.5 < expected[2] / of.bodies[1].skeleton.stature_m < 0.8


def test_velocity_is_the_derivative_of_position() -> None:
    messages = list(capture_truth(world("short_crossing")))
    for k in range(2):
        positions = np.array([message.people[k].position_m for message in messages])
        velocities = np.array([message.people[k].velocity_mps for message in messages])
        # The integral by the trapezoidal rule is the way from the start.
        route = np.cumsum((velocities[1:] + velocities[:-1]) / 2 * 0.01, axis=0)
        np.testing.assert_allclose(route, (positions - positions[0])[1:], atol=2e-3)
        # Most of it is walking: 1 m/s, across.
        assert np.median(np.abs(velocities[100:300, 1])) == pytest.approx(1.0, abs=0.1)


def test_yaw_of_a_person_who_faces_the_camera_is_pi() -> None:
    # docs/method.md section 1: to a camera that looks along +x, pi faces it, +pi/2 image-left.
    one, other = next(capture_truth(world("facing"))).people
    assert one.yaw_rad is not None
    assert other.yaw_rad is not None
    assert abs(wrap(one.yaw_rad - math.pi)) < math.radians(5)
    assert other.yaw_rad == pytest.approx(math.pi / 2, abs=math.radians(5))
    assert other.path_yaw_rad == pytest.approx(math.pi / 2, abs=1e-6)


def test_noise_has_the_configured_size() -> None:
    clean = capture_truth(World(scenario("facing")))
    noisy = capture_truth(World(scenario("facing", noise_m=0.002, yaw_noise_deg=1.0)))
    pairs = [
        (a, b)
        for m, n in zip(clean, noisy, strict=True)
        for a, b in zip(m.people, n.people, strict=True)
    ]
    moved = np.array([b.position_m - a.position_m for a, b in pairs])
    turned = np.array([wrap(b.yaw_rad - a.yaw_rad) for a, b in pairs])  # type: ignore[operator]
    # 402 samples: the standard error of a deviation is 1/sqrt(2 n), 3.5 % (axes: 2 %).
    assert moved.std() == pytest.approx(0.002, rel=0.1)
    assert turned.std() == pytest.approx(math.radians(1), rel=0.15)
    assert abs(moved.mean()) < 0.0003


def test_empty_room_gives_empty_messages() -> None:
    empty = replace(load_scenario("short_walk"), people=())
    messages = list(capture_truth(World(empty)))
    assert len(messages) == 301
    assert not any(message.people for message in messages)


def test_the_bridge_reads_truth_of_a_scenario_by_name() -> None:
    config = GtBridgeConfig(truth="lab:facing", source="lab.source:LabTruth")
    truth = open_truth(config)
    for _ in range(2):  # from the start each time
        first = next(iter(truth))
        assert isinstance(first, Truth)
        assert [person.id for person in first.people] == ["1", "2"]


def test_truth_of_no_scenario_is_refused() -> None:
    with pytest.raises(ConfigError, match="unknown scenario nowhere"):
        LabTruth(GtBridgeConfig(truth="nowhere"))
