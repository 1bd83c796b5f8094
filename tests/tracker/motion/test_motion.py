"""Motion and noise models against numbers worked on paper (docs/method.md section 3)."""

from dataclasses import replace

import numpy as np
import pytest

from services.tracker.interface import Measurement
from services.tracker.motion.motion import PositionMotion, confidence_factor, depth_factor
from services.tracker.sort3d.box_motion import BoxMotion
from tests.tracker.scene import published


def measurement(score: float = 0.8, forward_m: float = 2.5) -> Measurement:
    return Measurement(
        index=0,
        box_xyxy_px=np.array([100.0, 50.0, 140.0, 150.0]),
        score=score,
        position_m=np.array([1.0, 2.0, 3.0]),
        forward_m=forward_m,
    )


def test_white_acceleration_for_a_tenth_of_a_second() -> None:
    # sigma_a = 0.5, dt = 0.1: 0.25 * 1e-4 / 4 = 6.25e-6; 0.25 * 1e-3 / 2 = 1.25e-4;
    # 0.25 * 1e-2 = 2.5e-3. From P = 0 the prediction leaves Q alone.
    motion = PositionMotion(published())
    x, P = motion.predict(np.array([[1.0, 2.0, 3.0, 1.0, 0.0, -1.0]]), np.zeros((1, 6, 6)), 0.1)
    np.testing.assert_allclose(x, [[1.1, 2.0, 2.9, 1.0, 0.0, -1.0]])
    block = [[6.25e-6, 1.25e-4], [1.25e-4, 2.5e-3]]
    np.testing.assert_allclose(P[0], np.kron(block, np.eye(3)), atol=1e-18)


def test_zero_time_step_has_no_noise() -> None:
    motion = PositionMotion(published())
    x, P = motion.predict(np.ones((1, 6)), np.eye(6)[None], 0.0)
    np.testing.assert_array_equal(x, np.ones((1, 6)))
    np.testing.assert_array_equal(P, np.eye(6)[None])


def test_depth_and_score_scale_the_noise() -> None:
    # R = 0.5^2 = 0.25; depth 2.5 of 5 m: x 1.5 = 0.375; score 0.8: x 0.2 = 0.075.
    motion = PositionMotion(published())
    np.testing.assert_allclose(motion.gate_noise([measurement()])[0], 0.375 * np.eye(3))
    np.testing.assert_allclose(motion.noise([measurement()])[0], 0.075 * np.eye(3))


def test_a_certain_detection_leaves_some_noise() -> None:
    assert confidence_factor(1.0) == 0.05
    assert confidence_factor(0.97) == 0.05
    assert confidence_factor(0.4) == pytest.approx(0.6)


def test_depth_behind_the_camera_counts_as_none() -> None:
    np.testing.assert_allclose(depth_factor([-7.0, 0.0, 5.0]), [1.0, 1.0, 2.0])


def test_point_starts_with_zero_velocity_and_its_variance() -> None:
    x, P = PositionMotion(published()).start(measurement())
    np.testing.assert_allclose(x, [1.0, 2.0, 3.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(P, np.diag([0.075] * 3 + [4.0] * 3))  # 2 m/s squared


def test_box_is_measured_as_centre_area_and_aspect() -> None:
    # 40 wide, 100 high at (100, 50): centre (120, 100), area 4000, aspect 0.4.
    motion = BoxMotion()
    np.testing.assert_allclose(motion.measure([measurement()]), [[120, 100, 4000, 0.4, 1, 2, 3]])
    x, _ = motion.start(measurement())
    np.testing.assert_allclose(motion.boxes(x[None]), [[100, 50, 140, 150]])


def test_box_moves_with_constant_velocity_and_keeps_its_aspect() -> None:
    motion = BoxMotion()
    x = np.array([[120.0, 100.0, 4000.0, 0.4, 1, 2, 3, 10.0, -20.0, 500.0, 0.1, 0.2, 0.3]])
    moved, _ = motion.predict(x, np.eye(13)[None], 0.5)
    np.testing.assert_allclose(moved[0, :7], [125, 90, 4250, 0.4, 1.05, 2.1, 3.15])
    np.testing.assert_allclose(moved[0, 7:], x[0, 7:])


def test_box_noise_of_the_area_is_relative() -> None:
    # 10 % of 4000 = 400, squared 160000; 5 px squared 25; 0.1 squared 0.01; 0.15 m squared 0.0225.
    R = BoxMotion().noise([measurement()])[0]
    np.testing.assert_allclose(np.diag(R), [25, 25, 160000, 0.01, 0.0225, 0.0225, 0.0225])


def test_a_shrinking_area_stays_positive() -> None:
    motion = BoxMotion()
    x = np.zeros((1, 13))
    x[0, [2, 3, 9]] = 100.0, 0.5, -50.0
    moved, _ = motion.predict(x, np.eye(13)[None], 1.0)
    assert moved[0, 2] == 50.0
    moved, _ = motion.predict(moved, np.eye(13)[None], 1.0)  # 50 - 50 would be 0: it stops
    assert moved[0, 2] == 50.0
    assert moved[0, 9] == 0.0


def test_measured_noise_is_the_covariance_of_the_detection() -> None:
    # Measured diag(1, 4, 9) cm^2, plus (0.15 m)^2 in gates; depth and score do not change it.
    results = np.diag([1e-4, 4e-4, 9e-4])
    certain, plain = replace(measurement(), covariance_m2=results), measurement()
    motion = PositionMotion(published(noise="measured"))
    np.testing.assert_allclose(motion.noise([certain])[0], results)
    np.testing.assert_allclose(motion.gate_noise([certain])[0], results + 0.15**2 * np.eye(3))
    np.testing.assert_allclose(motion.start(certain)[1][:3, :3], results)
    # Without a covariance, and in constant mode with one, the noise is [PIC4SeR]'s.
    np.testing.assert_allclose(motion.noise([certain, plain])[1], 0.075 * np.eye(3))
    paper = PositionMotion(published())
    np.testing.assert_allclose(paper.noise([certain])[0], 0.075 * np.eye(3))
    assert motion.noise([]).shape == (0, 3, 3)
