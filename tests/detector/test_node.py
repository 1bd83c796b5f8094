import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import cv2
import msgspec
import numpy as np
import pytest

from common.config import load
from common.geometry.transforms import apply, invert
from common.transport.memory_bus import MemoryBus
from people4d.errors import ConfigError, ModelError
from people4d.messages import HIDDEN_RGB, U8, Crops, Detection, Detections, Message, RgbdFrame, Span
from people4d.messages.base import MAX_CAMERAS
from services.detector.build import build
from services.detector.config import DetectorConfig
from services.detector.models.base import DetectedPerson, InstanceMask
from services.detector.node import PEOPLE_MIN, DetectorNode
from tests import builders
from tests.detector.bodies import SIGMA_M, body_network
from tests.detector.cameras import INFO, lab_info
from tests.two_people import truth_of

M = TypeVar("M", bound=Message)


@dataclass
class FixedModel:
    """Finds the same people in all images; fails on images with a white first pixel."""

    people: list[DetectedPerson]
    name: str = "fixed"
    images: list[U8] = field(default_factory=list)

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        self.images.append(rgb)
        if rgb[0, 0, 0] == 255:
            raise RuntimeError("network burst")
        return self.people


def person(mask: bool = False, keypoints: bool = True) -> DetectedPerson:
    """Return a person in columns 10 to 19 and rows 10 to 49."""
    points = np.zeros((17, 3), np.float32)
    for index, u, v in ((5, 17, 20), (6, 12, 20), (11, 17, 40), (12, 12, 40)):
        points[index] = u, v, 0.9
    window = InstanceMask(np.ones((40, 11), np.uint8), x_px=10, y_px=10)
    box = np.array([8, 8, 22, 52], np.float32)
    return DetectedPerson(0.8, box, points if keypoints else None, window if mask else None)


def frame(sequence: int = 0, depth_mm: int = 2000, white: bool = False) -> RgbdFrame:
    """Return a frame with the person at a depth before a wall at 4 m."""
    depth = np.full((60, 40), 4000 if depth_mm else 0, np.uint16)
    depth[10:50, 10:21] = depth_mm
    rgb = np.full((60, 40, 3), 255 if white else 90, np.uint8)
    return RgbdFrame(
        stamp_ns=1000 + sequence,
        sequence=sequence,
        trace=(Span(stage="camera.read", process="camera-1@host", start_ns=1, end_ns=2),),
        camera="front",
        rgb=rgb,
        depth_mm=depth,
    )


# The methods of docs/method.md sections 2 and 6, which can be computed manually.
BY_HAND = {
    "position": "keypoints",
    "to_axis": "false",
    "covariance": "false",
    "orientation.method": "separate",
}


def node(*people: DetectedPerson, **settings: object) -> DetectorNode:
    values = BY_HAND | settings
    config = load(DetectorConfig, "detector", None, [f"{k}={v}" for k, v in values.items()], {})
    return DetectorNode(FixedModel(list(people)), config, body_network=body_network())


def only(kind: type[M], messages: list[Message]) -> M:
    found = [message for message in messages if isinstance(message, kind)]
    assert len(found) == 1
    return found[0]


def test_a_frame_gives_detections_and_crops_of_its_stamp() -> None:
    published = MemoryBus([node(person())]).publish(INFO, frame(7))
    detections, crops = only(Detections, published), only(Crops, published)
    for answer in (detections, crops):
        assert (answer.stamp_ns, answer.sequence, answer.camera) == (1007, 7, "front")
        assert [span.stage for span in answer.trace] == ["camera.read"]
    assert (detections.frame_id, detections.model) == ("front_optical_frame", "fixed")
    assert (detections.width, detections.height) == (40, 60)
    assert crops.crops[0].detection == 0
    assert detections.crops == 1
    assert crops.crops[0].rgb.shape == (44, 14, 3)


def test_position_by_keypoints() -> None:
    # Mean of u 17, 12, 17, 12 = 14.5 and v = 30 at 2 m: X = (14.5 - 20) * 2 / 50 = -0.22, Y = 0.
    detections = only(Detections, MemoryBus([node(person())]).publish(INFO, frame()))
    position = detections.detections[0].position_m
    assert position is not None
    np.testing.assert_allclose(position, [-0.22, 0.0, 2.0], atol=1e-12)


def test_heading_by_keypoints() -> None:
    # The right shoulder is 5 px left of the left one, at 2 m: d = (0, 0.2, 0), psi_1 = 180 deg.
    # Ratios -5/20 over 0.9 and 0.66: arccos 106.13 and 112.26, mean 109.19; the ray to u = 14.5
    # adds atan(5.5/50) = 6.28: psi_2 = 115.47, its sign from psi_1. Mean of the two: 147.74 deg.
    found = only(Detections, MemoryBus([node(person())]).publish(INFO, frame())).detections[0]
    assert found.heading is not None
    yaw_rad = np.radians(147.735)
    expected = [-np.sin(yaw_rad), 0.0, np.cos(yaw_rad)]
    np.testing.assert_allclose(found.heading, expected, atol=1e-4)
    assert found.heading_sigma_rad is not None
    assert found.heading_sigma_rad > 0


def test_heading_needs_keypoints() -> None:
    masked = node(person(mask=True, keypoints=False), position="mask")
    found = only(Detections, MemoryBus([masked]).publish(INFO, frame())).detections[0]
    assert (found.heading, found.heading_sigma_rad) == (None, None)
    assert found.position_m is not None


def test_position_by_mask() -> None:
    # Centroid of columns 10 to 20 is 15, of rows 10 to 49 is 29.5: X = -5 * 2 / 50 = -0.2,
    # Y = -0.5 * 2 / 50 = -0.02.
    published = MemoryBus([node(person(mask=True), position="mask")]).publish(INFO, frame())
    found = only(Detections, published).detections[0]
    assert found.position_m is not None
    assert found.mask is not None
    np.testing.assert_allclose(found.position_m, [-0.2, -0.02, 2.0], atol=1e-12)
    assert found.mask.window().sum() == 440


def test_position_method_is_used_alone() -> None:
    by_keypoints = node(person(mask=True), position="keypoints")
    found = only(Detections, MemoryBus([by_keypoints]).publish(INFO, frame())).detections[0]
    assert found.position_m is not None
    assert found.position_m[0] == pytest.approx(-0.22)
    no_mask = node(person(), position="mask")
    found = only(Detections, MemoryBus([no_mask]).publish(INFO, frame())).detections[0]
    assert found.position_m is None


def test_a_grown_mask_is_sent_with_detection_and_crop() -> None:
    published = MemoryBus([node(person(), position="grown")]).publish(INFO, frame())
    found, crop = only(Detections, published).detections[0], only(Crops, published).crops[0]
    assert found.mask is not None
    assert crop.mask is not None
    assert found.position_m is not None
    assert found.mask.window().sum() == crop.mask.sum() == 40 * 11
    np.testing.assert_allclose(found.position_m, [-0.2, -0.02, 2.0], atol=1e-12)


def test_an_empty_frame_is_answered() -> None:
    published = MemoryBus([node()]).publish(INFO, frame())
    assert only(Detections, published).detections == ()
    assert only(Crops, published).crops == ()
    assert only(Detections, published).crops == 0


def test_crops_can_be_left_out() -> None:
    published = MemoryBus([node(person(), crops="false")]).publish(INFO, frame())
    assert not any(isinstance(message, Crops) for message in published)
    assert only(Detections, published).crops == 0


def test_frames_before_the_calibration_are_dropped_and_reported() -> None:
    detector = node(person())
    bus = MemoryBus([detector])
    assert len(bus.publish(frame(0))) == 1
    status = detector.status()
    assert status.state == "degraded"
    assert status.reason == "camera front: no CameraInfo was received, its frames are dropped"
    assert status.counters == {"frames": 1, "no_calibration": 1}
    assert len(bus.publish(INFO, frame(1))) == 4
    assert detector.status().state == "ready"
    assert detector.status().counters == {
        "frames": 2,
        "no_calibration": 1,
        "people": 1,
        "with_position": 1,
        "with_heading": 1,
    }


def test_frames_of_another_size_are_dropped_and_reported() -> None:
    detector = node(person())
    small = builders.rgbd_frame(
        rgb=np.zeros((30, 20, 3), np.uint8), depth_mm=np.zeros((30, 20), np.uint16)
    )
    assert len(MemoryBus([detector]).publish(INFO, small)) == 2
    status = detector.status()
    assert status.counters["wrong_size"] == 1
    assert "expected 40x60 as in its CameraInfo, got 20x30" in status.reason


def test_without_depth_people_have_no_positions() -> None:
    detector = node(person(), person(mask=True))
    detections = only(Detections, MemoryBus([detector]).publish(INFO, frame(depth_mm=0)))
    assert [found.position_m for found in detections.detections] == [None, None]
    status = detector.status()
    assert status.counters == {
        "frames": 1,
        "no_depth": 1,
        "people": 2,
        "with_position": 0,
        "with_heading": 0,
    }
    assert (status.state, "depth image is empty" in status.reason) == ("degraded", True)


def test_depth_in_another_unit_is_reported() -> None:
    detector = node(person(), position="network")
    detector.handle(INFO, 0)
    for sequence in range(PEOPLE_MIN):
        assert detector.status().state == "ready"
        detector.handle(frame(sequence, depth_mm=60_000), 0)
    assert detector.status().reason.startswith("none of 10 people has a position")


def test_a_failing_model_gives_an_empty_frame_and_recovers() -> None:
    detector = node(person())
    bus = MemoryBus([detector])
    detections = only(Detections, bus.publish(INFO, frame(0, white=True)))
    assert detections.detections == ()
    assert detector.status().state == "degraded"
    assert "network burst" in detector.status().reason
    assert detector.status().counters["model_errors"] == 1
    assert len(only(Detections, bus.publish(frame(1))).detections) == 1
    assert detector.status().state == "ready"


def test_each_camera_has_its_own_calibration() -> None:
    detector = node(person())
    bus = MemoryBus([detector])
    bus.publish(INFO)
    other = builders.rgbd_frame(camera="rear", rgb=frame().rgb, depth_mm=frame().depth_mm)
    assert len(bus.publish(other)) == 1
    bus.publish(frame())
    assert detector.status().reason.startswith("camera rear: no CameraInfo")


def test_calibrations_of_invented_cameras_are_bounded_and_the_known_ones_go_on() -> None:
    invented = [msgspec.structs.replace(INFO, camera=f"c{number}") for number in range(200)]
    target = node(person())
    published = MemoryBus([target]).publish(INFO, *invented, INFO, frame())
    assert only(Detections, published).detections
    assert len(target._calibrations) == MAX_CAMERAS
    assert target.status().counters["refused_cameras"] == 201 - MAX_CAMERAS


def test_threads_may_share_the_node() -> None:
    detector = node(person())
    detector.handle(INFO, 0)
    together = threading.Barrier(4)

    def work(first: int) -> set[int]:
        together.wait(timeout=10)
        answers = [detector.handle(frame(first + i), 0) for i in range(50)]
        return {answer[0].sequence for answer in answers}

    with ThreadPoolExecutor(4) as pool:
        sequences = list(pool.map(work, range(0, 200, 50)))
    assert set().union(*sequences) == set(range(200))
    assert detector.status().counters == {
        "frames": 200,
        "people": 200,
        "with_position": 200,
        "with_heading": 200,
    }


def test_confidence_of_keypoints_suits_the_model_unless_set() -> None:
    config = DetectorConfig()
    assert config.confidence_for("yolov8n-pose") == 0.6
    assert config.confidence_for("movenet-multipose") == 0.3
    assert DetectorConfig(keypoint_confidence_min=0.45).confidence_for("movenet-multipose") == 0.45


@pytest.mark.parametrize(
    ("setting", "problem"),
    [
        ("keypoint_confidence_min=2", "keypoint_confidence_min: expected .* < 1"),
        ("input_height=100", "input_height: expected a multiple of 32"),
        ("depth_error_per_m=0", "depth_error_per_m: expected .* > 0"),
        ("orientation.methods=x", "Did you mean method"),
        ("position=guess", "position"),
        ("crop_height_max_px=3", "crop_height_max_px: expected .* >= 16"),
        ("threads=0", "threads: expected .*>= 1"),
    ],
)
def test_wrong_settings_are_reported(setting: str, problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        load(DetectorConfig, "detector", None, [setting], {})


def test_a_missing_model_is_reported_at_the_start() -> None:
    with pytest.raises(ModelError, match=r"nowhere\.onnx"):
        build(DetectorConfig(model="/nowhere.onnx"))


@pytest.mark.slow
def test_default_positions_of_people_in_the_simulated_room(shared: Path) -> None:
    # Measured over all frames: positions on the surface err by 0.105 m in the median.
    folder = shared / "data" / "lab" / "two"
    info = lab_info(truth_of(shared, "K"))
    bus = MemoryBus([build(DetectorConfig(crops=False))])
    bus.publish(info)
    errors, expected = [], 0
    for index in range(0, 150, 30):
        rgb = cv2.imread(str(folder / "rgb" / f"{index:05d}.jpg"), cv2.IMREAD_COLOR_RGB)
        depth = cv2.imread(str(folder / "depth" / f"{index:05d}.png"), cv2.IMREAD_UNCHANGED)
        message = RgbdFrame(
            stamp_ns=index,
            sequence=index,
            camera="lab",
            rgb=np.asarray(rgb, np.uint8),
            depth_mm=np.asarray(depth, np.uint16),
        )
        found = only(Detections, bus.publish(message)).detections
        positions = np.array([p.position_m for p in found if p.position_m is not None])
        for torso in truth_of(shared, "pos")[index][truth_of(shared, "vis")[index] > 0.5]:
            expected += 1
            expected_m = apply(invert(truth_of(shared, "T_world_cam")[index]), torso)
            errors.append(np.min(np.linalg.norm((positions - expected_m)[:, [0, 2]], axis=1)))
    assert expected >= 8
    assert np.median(errors) < 0.05
    assert np.max(errors) < 0.6


def detected(*people: DetectedPerson, **settings: object) -> tuple[Detection, ...]:
    detector = node(*people, **settings)
    return only(Detections, MemoryBus([detector]).publish(INFO, frame())).detections


@pytest.mark.parametrize("someone", [person(), person(mask=True, keypoints=False)])
def test_position_by_the_network(someone: DetectedPerson) -> None:
    # The box's columns 8 to 22: u = 15, X = (15 - 20) * 2 / 50 = -0.2; 0.3 m below its upper edge,
    # row 8: Y = (8 - 30) * 2 / 50 + 0.3 = -0.58.
    found = detected(someone, position="network")[0]
    assert found.position_m is not None
    np.testing.assert_allclose(found.position_m, [-0.2, -0.58, 2.0], atol=1e-6)
    assert found.position_covariance_m2 is None
    assert found.person == pytest.approx(0.5)
    assert detected(someone, position="keypoints")[0].person is None
    measured = detected(someone, position="network", covariance="true")[0]
    assert measured.position_covariance_m2 is not None
    np.testing.assert_allclose(measured.position_covariance_m2, SIGMA_M**2 * np.eye(3), atol=1e-9)


def test_a_network_is_required_by_its_method() -> None:
    with pytest.raises(ValueError, match="the body network is missing"):
        DetectorNode(FixedModel([]), DetectorConfig())


@pytest.mark.parametrize("method", ["keypoints", "mask"])
def test_positions_move_to_the_axis_if_configured(method: str) -> None:
    # Along the line of sight, between half the depth and half the width of the torso.
    someone = person(mask=method == "mask")
    surface = detected(someone, position=method)[0].position_m
    axis = detected(someone, position=method, to_axis="true")[0].position_m
    assert surface is not None
    assert axis is not None
    moved = axis - surface
    assert 0.125 < np.hypot(moved[0], moved[2]) < 0.205
    np.testing.assert_allclose(axis / axis[2], surface / surface[2], atol=1e-9)


@pytest.mark.parametrize("method", ["keypoints", "mask", "grown"])
def test_every_method_gives_a_covariance_if_configured(method: str) -> None:
    found = detected(person(mask=method == "mask"), position=method, covariance="true")[0]
    assert found.position_m is not None
    assert found.position_covariance_m2 is not None
    ray = found.position_m / np.linalg.norm(found.position_m)
    # The surface: at least 0.16 m from the axis along the line of sight.
    assert ray @ found.position_covariance_m2 @ ray > 0.16**2


def test_occluders_are_blanked_in_crops() -> None:
    # The left third of the box is at 1 m, the person at 2 m.
    behind = frame(7)
    depth_mm = np.full_like(behind.depth_mm, 2000)
    left, _, right, _ = person().box_xyxy_px.astype(int)
    depth_mm[:, : left + (right - left) // 3] = 1000
    message = msgspec.structs.replace(behind, depth_mm=depth_mm)
    for sent, is_blanked in ((message, True), (behind, False)):
        crops = only(Crops, MemoryBus([node(person(), position="network")]).publish(INFO, sent))
        assert (crops.crops[0].rgb == HIDDEN_RGB).all(axis=2).any() == is_blanked
