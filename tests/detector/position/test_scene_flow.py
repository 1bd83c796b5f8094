"""Velocities by scene flow, of a textured board that moves before a wall."""

import numpy as np
import pytest

from people4d.messages import F64, U8, U16, RgbdFrame
from services.detector.position.scene_flow import (
    FrameHistory,
    FramePair,
    VelocityEstimate,
    measure_velocities,
)
from services.detector.position.surface import DepthImage
from services.detector.position.torso import find_torsos
from tests import builders
from tests.detector.position.test_torso import INFO, keypoints, person

FX, STEP_NS = 600.0, 100_000_000


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


def velocity(first: RgbdFrame, second: RgbdFrame, *columns: float) -> list[VelocityEstimate | None]:
    """Return the velocities in the second frame of people at 2 m, about columns of the image."""
    history = FrameHistory()
    history.swap_frame(first)
    before = history.swap_frame(second)
    people = [person(keypoints(u)) for u in columns or (320.0,)]
    if before is None:
        return [None] * len(people)
    torsos = find_torsos(people, 0.3, DepthImage(second.depth_mm, INFO))
    return measure_velocities(FramePair(second, before, INFO), torsos)


@pytest.mark.parametrize(
    ("columns", "moved_m"), [(0, 0.0), (6, 0.0), (-12, 0.0), (0, 0.1), (6, -0.1)]
)
def test_velocity_of_a_board(columns: int, moved_m: float) -> None:
    # 6 px at 2 m and 600 px are 0.02 m: 0.2 m/s in a tenth of a second. The wall moves the other
    # way, as before a camera that turns.
    first = frame(0, board_images(320 - columns, 2.0 - moved_m))
    (found,) = velocity(first, frame(1, board_images(320, 2.0, wall_shift=9)))
    assert found is not None
    expected: F64 = np.array([columns * 2.0 / FX, 0.0, moved_m]) / 0.1
    np.testing.assert_allclose(found.velocity_mps, expected, atol=0.04)
    # The torso is 144 px wide, and followed at 48: 0.9 px across and 0.0032 * 2^2 m along, over
    # 0.1 s: 0.03 and 0.128 m/s; the surface's 0.1 m/s for 0.35 s: 0.1^2 * 0.7 / 0.1 = 0.07.
    sigmas = np.sqrt(np.diag(found.covariance_m2ps2))
    np.testing.assert_allclose(sigmas, [0.2663, 0.2663, 0.294], rtol=0.02)


def test_surface_motion_counts_for_its_correlation_time_at_any_frame_rate() -> None:
    # n frames of variance 0.1^2 * 0.7 / dt in one second: mean 0.1^2 * 0.7 / dt / n = 0.007.
    images = board_images(320, 2.0)
    for step_s in (0.05, 0.1, 0.2):
        second = builders.rgbd_frame(
            stamp_ns=round(step_s * 1e9), camera="front", rgb=images[0], depth_mm=images[1]
        )
        (found,) = velocity(frame(0, images), second)
        assert found is not None
        pixel_mps = 0.9 * 2.0 / FX / step_s
        surface = found.covariance_m2ps2[0, 0] - pixel_mps**2
        assert surface * step_s == pytest.approx(0.007, rel=1e-3)


def test_motions_between_steps_of_depth() -> None:
    # A slanted board goes 30 mm away from a camera whose depth comes in steps of 50 mm: three of
    # five pixels are a step farther than before, the others where they were.
    rgb, depth_mm = board_images(320, 2.0)
    slanted_mm = 2000 + np.arange(-100, 100)
    images = []
    for moved_mm in (0, 30):
        stepped = depth_mm.copy()
        stepped[120:480, 220:420] = np.rint((slanted_mm + moved_mm) / 50) * 50
        images.append((rgb, stepped))
    (found,) = velocity(frame(0, images[0]), frame(1, images[1]))
    assert found is not None
    assert abs(found.velocity_mps[2] - 0.3) < 0.1


def test_a_spread_of_motions_makes_the_velocity_uncertain() -> None:
    rgb, depth_mm = board_images(320, 2.0)
    sheared = rgb.copy()
    for row in range(120, 480):
        sheared[row] = np.roll(rgb[row], (row - 240) // 12, axis=0)
    (plain,) = velocity(frame(0, (rgb, depth_mm)), frame(1, (rgb, depth_mm)))
    (found,) = velocity(frame(0, (sheared, depth_mm)), frame(1, (rgb, depth_mm)))
    assert plain is not None
    assert found is not None
    assert found.covariance_m2ps2[0, 0] > plain.covariance_m2ps2[0, 0] + 3 * 0.01**2


def test_points_on_two_torsos_are_not_used() -> None:
    # Torsos at columns 270 and 370, each 144 px wide with its margins, share 44 px.
    first, second = frame(0, board_images(320, 2.0)), frame(1, board_images(320, 2.0))
    assert all(found is not None for found in velocity(first, second, 270.0, 370.0))
    (torso,) = find_torsos([person(keypoints())], 0.3, DepthImage(second.depth_mm, INFO))
    assert measure_velocities(FramePair(second, first, INFO), [torso, torso]) == [None, None]


def test_a_person_behind_another_is_not_measured_on_them() -> None:
    # The board stands still at 2 m and covers the left half of a person at 2.2 m: points in that
    # half lie on the board.
    rgb, depth_mm = board_images(320, 2.0)
    moved, deep_mm = rgb.copy(), depth_mm.copy()
    moved[120:480, 420:500] = np.repeat(BOARD[:360, 100:180, None], 3, axis=2)
    before = rgb.copy()
    before[120:480, 408:488] = np.repeat(BOARD[:360, 100:180, None], 3, axis=2)
    before[120:480, 220:420] = rgb[120:480, 220:420]
    deep_mm[120:480, 420:500] = 2200
    _, behind = velocity(frame(0, (before, deep_mm)), frame(1, (moved, deep_mm)), 320.0, 430.0)
    assert behind is None or behind.velocity_mps[0] > 0.2


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
    assert velocity(first, second) == [None]


def test_velocities_go_on_after_a_clock_that_went_back() -> None:
    history, images = FrameHistory(), board_images(320, 2.0)
    history.swap_frame(frame(100, images))
    first = frame(10, images)
    assert history.swap_frame(first) is None
    assert history.swap_frame(frame(11, images)) is first


def test_a_late_frame_does_not_replace_a_newer_one() -> None:
    history, images = FrameHistory(), board_images(320, 2.0)
    newest = frame(4, images)
    history.swap_frame(newest)
    assert history.swap_frame(frame(3, images)) is None
    assert history.swap_frame(frame(5, images)) is newest


def test_a_hidden_torso_has_no_velocity() -> None:
    rgb, depth_mm = board_images(320, 2.0)
    hidden = depth_mm.copy()
    hidden[100:480, 200:440] = 0
    assert velocity(frame(0, (rgb, depth_mm)), frame(1, (rgb, hidden))) == [None]


def test_torsos_outside_of_the_image_have_no_velocity() -> None:
    images = board_images(320, 2.0)
    assert velocity(frame(0, images), frame(1, images), 2000.0, 320.0)[0] is None


def test_no_people() -> None:
    images = board_images(320, 2.0)
    pair = FramePair(frame(1, images), frame(0, images), INFO)
    assert measure_velocities(pair, []) == []
    assert measure_velocities(pair, [None]) == [None]
