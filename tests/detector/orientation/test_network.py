"""Yaw by images: the network's input, its likelihood, and what ships."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from common.geometry.transforms import wrap
from evaluation.quantization.images import bodies_of
from evaluation.recordings.rendered import RenderedFrame, render
from people4d.errors import ModelError
from people4d.messages import F32, F64, HIDDEN_RGB
from services.detector.build import check, load_networks
from services.detector.config import DetectorConfig, OrientationConfig, shipped_orientation
from services.detector.orientation.joint import ANGLES
from services.detector.orientation.network import SIZE_PX, OrientationNetwork, upper_bodies
from services.detector.position.surface import DepthImage
from tests import builders
from tests.detector.array_session import ArraySession

SHAPE = (None, 4, *SIZE_PX)
INFO = builders.camera_info(width=200, height=200, fx=100.0, cx=100.0, cy=100.0)
RED, GREY = (200, 0, 0), (90, 90, 90)


def network(log_p: F32, shape: tuple[int | None, ...] = SHAPE) -> OrientationNetwork:
    return OrientationNetwork(ArraySession({"log_probabilities": log_p}, shape))


def likelihood(log_p: F32) -> F64:
    images = np.zeros((len(log_p), 4, *SIZE_PX), np.float32)
    return network(log_p).log_likelihood(images)


def sectors(most_likely: int, count: int = 24) -> F32:
    log_p = np.full((1, count), -20.0, np.float32)
    log_p[0, most_likely] = 0.0
    return log_p


def keypoints(u: float, v: float) -> F32:
    """Return keypoints whose shoulders are 20 pixels apart with their middle at a pixel."""
    points = np.zeros((1, 17, 3), np.float32)
    points[0, 5], points[0, 6] = (u - 10, v, 0.9), (u + 10, v, 0.9)
    return points


@pytest.mark.parametrize("sector", [0, 1, 6, 12, 23])
def test_angles_of_the_likely_sector_are_likely(sector: int) -> None:
    (found,) = likelihood(sectors(sector))
    assert abs(wrap(ANGLES[found.argmax()] - math.radians(15 * sector))) < 1e-9
    assert found.max() - found.min() < math.log(24 / 0.05)


def test_between_two_sectors_the_likelihood_is_between_theirs() -> None:
    log_p = sectors(3)
    log_p[0, 4] = -1.0
    (found,) = likelihood(log_p)
    at = dict(zip(np.round(np.degrees(ANGLES)).astype(int).tolist(), found, strict=True))
    assert at[45] > at[48] > at[57] > at[60] > at[75]


def test_uninformative_image_is_equally_likely_at_all_angles() -> None:
    found = likelihood(np.full((1, 24), -math.log(24), np.float32))
    assert np.ptp(found) < 1e-9


def test_outliers_limit_the_likelihood_of_an_image() -> None:
    # All in one sector of 24: 0.95 + 0.05 / 24 against 0.05 / 24.
    found = likelihood(sectors(0))
    assert np.ptp(found) == pytest.approx(math.log(0.95 * 24 / 0.05 + 1), abs=1e-6)


def test_numbers_that_no_probability_has_are_harmless() -> None:
    log_p = np.full((1, 24), -np.inf, np.float32)
    log_p[0, 5] = 7.0
    assert np.isfinite(likelihood(log_p)).all()


@pytest.mark.parametrize("shape", [(None, 3, *SIZE_PX), (None, 4, 48, 24), (1, 4, *SIZE_PX), (4,)])
def test_other_inputs_are_refused(shape: tuple[int | None, ...]) -> None:
    with pytest.raises(ModelError, match=r"expected an input of \[None, 4, 64, 48\], got"):
        network(sectors(0), shape)


def test_other_outputs_are_refused() -> None:
    with pytest.raises(ModelError, match="expected an output of NxS"):
        network(np.zeros((1, 24, 2), np.float32))


def test_the_window_reaches_from_above_the_head_to_the_hips() -> None:
    rgb = np.full((200, 200, 3), GREY, np.uint8)
    rgb[30:140, 59:142] = RED  # at 1 m, 100 pixels a metre: 0.5 m above, 0.6 m below
    depth = DepthImage(np.full((200, 200), 1000, np.uint16), INFO)
    (image,) = upper_bodies(rgb, depth, keypoints(100, 80), np.array([1.0]))
    assert image.shape == (4, *SIZE_PX)
    np.testing.assert_allclose(image[0], RED[0] / 255, atol=0.01)
    assert (image[3] == 1).all()


def test_nearer_things_are_blanked_and_farther_ones_are_no_person() -> None:
    rgb = np.full((200, 200, 3), RED, np.uint8)
    depth_mm = np.full((200, 200), 1000, np.uint16)
    depth_mm[:, :80], depth_mm[:, 120:] = 500, 1600
    depth_mm[:50, 90:110] = 0  # no reading
    depth = DepthImage(depth_mm, INFO)
    (image,) = upper_bodies(rgb, depth, keypoints(100, 80), np.array([1.0]))
    left, middle, right = image[:, :, :11], image[:, :, 14:34], image[:, :, 37:]
    np.testing.assert_allclose(left[:3, 5, 5] * 255, HIDDEN_RGB, atol=0.5)
    assert (left[3] == 0).all()
    assert (middle[3] == 1).all()
    assert (right[3] == 0).all()
    np.testing.assert_allclose(right[0], RED[0] / 255, atol=0.01)


@pytest.mark.parametrize(("u", "v"), [(0, 0), (199, 199), (-5000, 80), (1e9, -1e9)])
@pytest.mark.parametrize("depth_m", [0.05, 1.0, 60.0])
def test_pixels_outside_the_image_are_blanked(u: float, v: float, depth_m: float) -> None:
    rgb = np.full((200, 200, 3), RED, np.uint8)
    depth = DepthImage(np.full((200, 200), 1000, np.uint16), INFO)
    (image,) = upper_bodies(rgb, depth, keypoints(u, v), np.array([depth_m]))
    assert image.shape == (4, *SIZE_PX)
    outside = image[3] == 0
    assert np.isfinite(image).all()
    if abs(u) > 1000:
        assert outside.all()
        np.testing.assert_allclose(image[:3, 0, 0] * 255, HIDDEN_RGB, atol=0.5)


@pytest.fixture(scope="module")
def rendered_frames() -> list[RenderedFrame]:
    return list(render([("four_crossing", 5, range(60, 460, 100))]))


@pytest.mark.parametrize("name", ["orientation-lab", "orientation-lab-int8"])
def test_the_shipped_network_sees_where_people_of_the_lab_face(
    name: str, rendered_frames: list[RenderedFrame]
) -> None:
    shipped = load_networks(DetectorConfig(orientation=OrientationConfig(network=name)))[0]
    assert shipped is not None
    errors = list[float]()
    for rendered in rendered_frames:
        likelihoods = shipped.log_likelihood(bodies_of(rendered))
        people = zip(rendered.people, rendered.positions_m, likelihoods, strict=True)
        for person, position_m, found in people:
            forward = np.array([math.cos(person.yaw_rad), math.sin(person.yaw_rad), 0.0])
            across, _, ahead = rendered.map_from_optical[:3, :3].T @ forward
            ray_rad = math.atan2(-position_m[0], position_m[2])
            true_rad = math.atan2(-across, ahead) - ray_rad
            errors.append(abs(math.degrees(wrap(ANGLES[found.argmax()] - true_rad))))
    assert len(errors) > 10
    assert np.median(errors) < 12
    assert np.mean(np.array(errors) > 90) < 0.1


def test_only_the_joint_method_needs_the_network() -> None:
    assert DetectorConfig().orientation_network == shipped_orientation()
    separate = OrientationConfig(method="separate")
    assert DetectorConfig(orientation=separate).orientation_network == ""


def test_an_absent_network_is_reported_before_the_start() -> None:
    config = DetectorConfig()
    check(config)
    absent = replace(config, orientation=OrientationConfig(network="/nowhere.onnx"))
    with pytest.raises(ModelError, match=r"model file /nowhere\.onnx does not exist"):
        check(absent)
