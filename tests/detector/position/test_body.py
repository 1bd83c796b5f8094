"""Positions by the body network: its input, its outputs, and what ships."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from msgspec.structs import replace

from evaluation.recordings.rendered import RenderedFrame, render
from people4d.errors import ModelError
from people4d.messages import F32, F64, HIDDEN_RGB, U8, U16
from services.detector.build import check, load_networks
from services.detector.config import DetectorConfig
from services.detector.position.body import BodyNetwork
from services.detector.position.surface import DepthImage, PositionEstimate
from tests import builders
from tests.detector.array_session import ArraySession
from tests.detector.bodies import SIGMA_M, RowSession, body_network, row

SHAPE = (None, 7, 48, 32)
INFO = builders.camera_info(width=200, height=200, fx=100.0, cx=100.0, cy=100.0)
RED, GREY = (200, 0, 0), (90, 90, 90)


@dataclass
class Scene:
    """A person-sized board in front of a wall, 100 pixels a metre at 1 m."""

    rgb: U8
    depth_mm: U16


def board(depth_mm: int = 1000) -> Scene:
    """Return a red board in columns 75 to 124 before a grey wall at 3 m."""
    rgb = np.full((200, 200, 3), GREY, np.uint8)
    depth = np.full((200, 200), 3000, np.uint16)
    rgb[40:, 75:125], depth[40:, 75:125] = RED, depth_mm
    return Scene(rgb, depth)


BOX: F64 = np.array([[75.0, 40.0, 125.0, 200.0]])


def images(scene: Scene, box: F64 = BOX, depth_m: float = 1.0) -> F32:
    network = body_network()
    image = DepthImage(scene.depth_mm, INFO)
    return network.candidates(box, np.array([depth_m]), scene.rgb, image).images


def bodies(values: list[float], box: F64 = BOX, depth_m: float = 1.0) -> list[PositionEstimate]:
    network = BodyNetwork(RowSession(values))
    scene = board()
    image = DepthImage(scene.depth_mm, INFO)
    return network.observe(network.candidates(box, np.array([depth_m]), scene.rgb, image))


def test_reference_is_below_the_upper_edge_of_the_box() -> None:
    # Row 40 and 0.3 m below, 30 px: row 70; (70 - 100) / 100 = -0.3 m; the middle column is 100.
    (found,) = bodies(row())
    np.testing.assert_allclose(found.position_m, [0.0, -0.3, 1.0], atol=1e-9)


def test_offsets_are_to_the_right_down_and_along_the_ray() -> None:
    # Columns 150 to 200 at 2 m: u = 175, x = 1.5 m, z = 2 m, the line of sight is (0.6, 0, 0.8),
    # to the right is (0.8, 0, -0.6): x + 0.08 + 0.12, y = (40 + 15 - 100) / 50 + 0.3.
    aside = np.array([[150.0, 40.0, 200.0, 200.0]])
    (found,) = bodies(row(offset_m=(0.1, 0.3, 0.2)), aside, 2.0)
    expected = [1.5 + 0.08 + 0.12, -0.9 + 0.3, 2.0 - 0.06 + 0.16]
    np.testing.assert_allclose(found.position_m, expected, atol=1e-6)


def test_covariance_is_turned_to_the_ray() -> None:
    values = row()
    (ahead,) = bodies(values)
    assert ahead.covariance_m2 is not None
    np.testing.assert_allclose(ahead.covariance_m2, SIGMA_M**2 * np.eye(3), atol=1e-9)
    values[6] = math.log(math.expm1(0.2 - 0.01))  # along the line of sight
    (aside,) = bodies(values, np.array([[150.0, 40.0, 200.0, 200.0]]), 2.0)
    assert aside.covariance_m2 is not None
    ray = np.array([0.6, 0.0, 0.8])
    assert ray @ aside.covariance_m2 @ ray == pytest.approx(0.2**2)


def test_first_output_is_the_logit_of_a_person() -> None:
    for logit, expected in ((0.0, 0.5), (math.log(9), 0.9), (-1e4, 0.0), (1e4, 1.0)):
        values = row()
        values[0] = logit
        (found,) = bodies(values)
        assert found.person == pytest.approx(expected, abs=1e-6)


def test_correlated_errors_are_in_the_covariance() -> None:
    values = row()
    values[5] = 0.05  # error along the line of sight for each unit across
    (found,) = bodies(values)
    assert found.covariance_m2 is not None
    assert found.covariance_m2[0, 2] == pytest.approx(0.05 * SIGMA_M)
    assert found.covariance_m2[2, 2] == pytest.approx(0.05**2 + SIGMA_M**2)


def test_extreme_outputs_are_finite() -> None:
    (found,) = bodies([1e4, 0, 0, 0, -1e4, 0, -1e4, 0, 1e4])
    assert found.covariance_m2 is not None
    assert np.linalg.eigvalsh(found.covariance_m2)[0] > 0


def test_channels_are_colour_mask_relative_depth_relief_and_readings() -> None:
    scene = board()
    scene.depth_mm[100:110, 95:105] = 0  # no reading
    scene.depth_mm[70:90, 95:105] = 1100  # 0.1 m behind the layer
    (image,) = images(scene)
    # The window begins 0.2 m above the box, row 20, and 0.55 m to the left, column 45: 3.44 px
    # each. Column 100 is in the middle, row 80 at 17.4, row 105 at 24.7, row 150 at 37.8.
    assert image.shape == SHAPE[1:]
    np.testing.assert_allclose(image[:3, 37, 16], np.array(RED) / 255, atol=0.01)
    np.testing.assert_allclose(image[3:, 37, 16], [1, 0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(image[3:, 17, 16], [1, 0.1 / 0.6, 0.5, 1], atol=1e-6)
    np.testing.assert_allclose(image[3:, 24, 16], [1, 0, 0, 0], atol=1e-6)
    # The wall is no part of the person, 2 m behind.
    np.testing.assert_allclose(image[:3, 37, 2], np.array(GREY) / 255, atol=0.01)
    np.testing.assert_allclose(image[3:, 37, 2], [0, 1, 1, 1], atol=1e-6)


def test_pixels_beyond_the_image_are_blank() -> None:
    (image,) = images(board(), np.array([[-25.0, 40.0, 25.0, 200.0]]))
    np.testing.assert_allclose(image[:3, 20, 5] * 255, HIDDEN_RGB, atol=0.5)
    np.testing.assert_allclose(image[3:, 20, 5], 0)


def test_images_with_margins_contain_those_without() -> None:
    # 4 px of the image for each pixel at 0.86 m, in the middle column 100: no rounding.
    scene, depths_m = board(), np.array([0.86])
    image = DepthImage(scene.depth_mm, INFO)
    (plain,) = BodyNetwork.candidates(BOX, depths_m, scene.rgb, image).images
    (wide,) = BodyNetwork.candidates(BOX, depths_m, scene.rgb, image, margin_px=3).images
    assert wide.shape == (7, 54, 38)
    np.testing.assert_array_equal(wide[:, 3:-3, 3:-3], plain)


@pytest.mark.parametrize(
    "box", [(0, 0, 1, 2), (199, 199, 200, 200), (-5000, 80, -4000, 90), (1e9, -1e9, 1e9, 1e9)]
)
@pytest.mark.parametrize("depth_m", [0.05, 1.0, 60.0])
def test_odd_boxes_give_finite_images(box: tuple[float, ...], depth_m: float) -> None:
    image = images(board(), np.array([box], np.float64), depth_m)
    assert image.shape == (1, *SHAPE[1:])
    assert np.isfinite(image).all()
    assert np.abs(image).max() <= 1


@pytest.mark.parametrize("shape", [(None, 6, 48, 32), (None, 7, 96, 64), (1, 7, 48, 32), (4,)])
def test_other_inputs_are_refused(shape: tuple[int | None, ...]) -> None:
    with pytest.raises(ModelError, match=r"expected an input of \[None, 7, 48, 32\], got"):
        BodyNetwork(ArraySession({"body": np.zeros((1, 9), np.float32)}, shape))


@pytest.mark.parametrize("output", [np.zeros((1, 7)), np.full((1, 9), np.nan), np.zeros(9)])
def test_other_outputs_and_weights_without_values_are_refused(output: F64) -> None:
    with pytest.raises(ModelError, match="expected finite outputs of Nx9"):
        BodyNetwork(ArraySession({"body": output.astype(np.float32)}, SHAPE))


def test_only_the_method_of_the_network_needs_it() -> None:
    assert DetectorConfig().body_network == "body-lab"
    assert DetectorConfig(position="keypoints").body_network == ""
    assert load_networks(DetectorConfig(position="mask"))[1] is None


def test_an_absent_network_is_reported_before_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    config = DetectorConfig()
    check(config)
    monkeypatch.setattr("services.detector.config.BODY_NETWORK", "/nowhere.onnx")
    with pytest.raises(ModelError, match=r"model file /nowhere\.onnx does not exist"):
        check(replace(config))


@pytest.fixture(scope="module")
def shipped() -> BodyNetwork:
    network = load_networks(DetectorConfig())[1]
    assert network is not None
    return network


@pytest.fixture(scope="module")
def rendered_frames() -> list[RenderedFrame]:
    return list(render([("four_crossing", 5, range(60, 460, 40))]))


def test_the_shipped_network_locates_people_of_the_lab(
    shipped: BodyNetwork, rendered_frames: list[RenderedFrame]
) -> None:
    errors, inside = list[float](), list[bool]()
    for rendered in rendered_frames:
        image = DepthImage(rendered.frame.depth_mm, rendered.info)
        for someone, position_m in zip(rendered.people, rendered.positions_m, strict=True):
            joints = np.asarray(someone.keypoints_px, np.float64)
            low, high = joints.min(axis=0) - 8, joints.max(axis=0) + 8
            box = np.array([[*low, *high]])
            layer_m = np.array([position_m[2] - 0.12])
            found = shipped.observe(shipped.candidates(box, layer_m, rendered.frame.rgb, image))[0]
            assert found.covariance_m2 is not None
            error = (found.position_m - position_m)[[0, 2]]
            flat = found.covariance_m2[np.ix_([0, 2], [0, 2])]
            errors.append(float(np.hypot(*error)))
            inside.append(bool(error @ np.linalg.solve(flat, error) < 4.605))  # 90 % of chi-square
    assert len(errors) > 20
    assert np.median(errors) < 0.05
    assert np.mean(inside) > 0.8
