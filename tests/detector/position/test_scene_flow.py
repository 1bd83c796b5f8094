"""Velocities by scene flow, of a textured board that moves before a wall."""

import numpy as np
import pytest

from people4d.messages import F64, U8, U16, RgbdFrame
from services.detector.config import TorsoConfig, UncertaintyConfig, VelocityConfig
from services.detector.position.scene_flow import SceneFlow, VelocityEstimate
from services.detector.position.surface import DepthImage
from services.detector.position.torso import TorsoEstimator
from tests import builders
from tests.detector.position.test_torso import INFO, keypoints, person

FX, STEP_NS = 600.0, 100_000_000
TORSO = TorsoEstimator(TorsoConfig(), None, UncertaintyConfig())


def texture(seed: int, height: int, width: int) -> U8:
    """Grey values that change over several pixels."""
    coarse = np.random.default_rng(seed).integers(0, 255, (height // 4 + 2, width // 4 + 2))
    return coarse.repeat(4, axis=0).repeat(4, axis=1)[:height, :width].astype(np.uint8)


WALL, BOARD = texture(1, 480, 640), texture(2, 400, 200)


def board_images(u: int, z_m: float, wall_shift: int = 0) -> tuple[U8, U16]:
    """A board from row 120 on, about a column, at a depth before a wall at 4 m."""
    grey, depth_mm = np.roll(WALL, wall_shift, axis=1), np.full((480, 640), 4000, np.uint16)
    grey[120:480, u - 100 : u + 100] = BOARD[:360]
    depth_mm[120:480, u - 100 : u + 100] = round(1000 * z_m)
    return np.repeat(grey[..., None], 3, axis=2), depth_mm


def frame(number: int, images: tuple[U8, U16], camera: str = "front") -> RgbdFrame:
    return builders.rgbd_frame(
        stamp_ns=number * STEP_NS, camera=camera, rgb=images[0], depth_mm=images[1]
    )


def velocity(
    flow: SceneFlow, first: RgbdFrame, second: RgbdFrame, u: float = 320.0, z_m: float = 2.0
) -> VelocityEstimate | None:
    """Return the velocity of a person on the board in the second frame."""
    flow.next(first)
    now, before = flow.next(second)
    if before is None:
        return None
    image = DepthImage(second.depth_mm, INFO)
    torsos = TORSO.find([person(keypoints(u, z_m))], 0.3, image)
    return flow.velocities(now, before, torsos, INFO)[0]


@pytest.mark.parametrize(
    ("columns", "moved_m"), [(0, 0.0), (6, 0.0), (-12, 0.0), (0, 0.1), (6, -0.1)]
)
def test_velocity_of_a_board(columns: int, moved_m: float) -> None:
    # 6 px at 2 m and 600 px are 0.02 m: 0.2 m/s in a tenth of a second. The wall moves the other
    # way, as before a camera that turns.
    flow = SceneFlow(VelocityConfig())
    first = frame(0, board_images(320 - columns, 2.0 - moved_m))
    found = velocity(flow, first, frame(1, board_images(320, 2.0, wall_shift=9)))
    assert found is not None
    expected: F64 = np.array([columns * 2.0 / FX, 0.0, moved_m]) / 0.1
    np.testing.assert_allclose(found.velocity_mps, expected, atol=0.03)
    sigmas = np.sqrt(np.diag(found.covariance_m2ps2))
    # 0.3 px across and 0.0032 * 2^2 m along, over 0.1 s.
    np.testing.assert_allclose(sigmas, [0.01, 0.01, 0.128], rtol=0.3)


def test_movements_between_steps_of_depth() -> None:
    # A slanted board goes 30 mm away from a camera whose depth comes in steps of 50 mm: three of
    # five pixels are a step farther than before, the others where they were.
    rgb, depth_mm = board_images(320, 2.0)
    slanted_mm = 2000 + np.arange(-100, 100)
    images = []
    for moved_mm in (0, 30):
        stepped = depth_mm.copy()
        stepped[120:480, 220:420] = np.rint((slanted_mm + moved_mm) / 50) * 50
        images.append((rgb, stepped))
    found = velocity(SceneFlow(VelocityConfig()), frame(0, images[0]), frame(1, images[1]))
    assert found is not None
    assert abs(found.velocity_mps[2] - 0.3) < 0.1


def test_a_spread_of_movements_makes_the_velocity_uncertain() -> None:
    rgb, depth_mm = board_images(320, 2.0)
    sheared = rgb.copy()
    for row in range(120, 480):
        sheared[row] = np.roll(rgb[row], (row - 240) // 12, axis=0)
    flow = SceneFlow(VelocityConfig())
    found = velocity(flow, frame(0, (sheared, depth_mm)), frame(1, (rgb, depth_mm)))
    assert found is not None
    assert found.covariance_m2ps2[0, 0] > 4 * 0.01**2


@pytest.mark.parametrize("fault", ["late", "backwards", "same time", "size", "camera", "depth"])
def test_no_velocity_without_a_frame_to_compare(fault: str) -> None:
    images = board_images(320, 2.0)
    first, second = frame(3, images), frame(4, images)
    match fault:
        case "late":
            second = frame(6, images)
        case "backwards":
            second = frame(2, images)
        case "same time":
            second = frame(3, images)
        case "size":
            first = frame(3, (images[0][:240], images[1][:240]))
        case "camera":
            first = frame(3, images, camera="rear")
        case "depth":
            first = frame(3, (images[0], np.zeros_like(images[1])))
    assert velocity(SceneFlow(VelocityConfig()), first, second) is None


def test_velocities_go_on_after_a_clock_that_went_back() -> None:
    flow, images = SceneFlow(VelocityConfig()), board_images(320, 2.0)
    flow.next(frame(100, images))
    assert velocity(flow, frame(10, images), frame(11, images)) is not None


def test_a_late_frame_does_not_replace_a_newer_one() -> None:
    flow, images = SceneFlow(VelocityConfig()), board_images(320, 2.0)
    newest, _ = flow.next(frame(4, images))
    assert flow.next(frame(3, images))[1] is None
    assert flow.next(frame(5, images))[1] is newest


def test_a_hidden_or_featureless_torso_has_no_velocity() -> None:
    flow, (rgb, depth_mm) = SceneFlow(VelocityConfig()), board_images(320, 2.0)
    hidden = depth_mm.copy()
    hidden[100:480, 200:440] = 0
    assert velocity(flow, frame(0, (rgb, depth_mm)), frame(1, (rgb, hidden))) is None


def test_no_people() -> None:
    flow, images = SceneFlow(VelocityConfig()), board_images(320, 2.0)
    flow.next(frame(0, images))
    now, before = flow.next(frame(1, images))
    assert before is not None
    assert flow.velocities(now, before, [], INFO) == []
    assert flow.velocities(now, before, [None], INFO) == [None]


def test_what_is_stored_is_a_copy() -> None:
    flow, (rgb, depth_mm) = SceneFlow(VelocityConfig()), board_images(320, 2.0)
    now, _ = flow.next(frame(0, (rgb, depth_mm)))
    depth_mm[:] = 0
    assert now.depth_mm.any()
