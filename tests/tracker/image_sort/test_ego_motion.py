"""Turns from a stream of odometry, worked by hand."""

import math

import pytest

from common.geometry.transform_history import TransformBufferConfig
from people4d.messages import Odometry
from services.tracker.image_sort.camera_turn import STILL
from services.tracker.image_sort.ego_motion import EgoMotion

MS = 1_000_000


def told(at_ms: int, theta_deg: float) -> Odometry:
    return Odometry(
        stamp_ns=at_ms * MS,
        sequence=0,
        frame_id="odom",
        child_frame_id="base_link",
        x_m=0.0,
        y_m=0.0,
        theta_rad=math.radians(theta_deg),
    )


def fed(*samples: tuple[int, float], wait_s: float = 0.05) -> EgoMotion:
    motion = EgoMotion(TransformBufferConfig(), wait_s)
    for at_ms, theta_deg in samples:
        motion.add(told(at_ms, theta_deg))
    return motion


def degrees(motion: EgoMotion, at_ms: int) -> float:
    return math.degrees(motion.turn_to(at_ms * MS).rad)


def test_the_first_frame_has_no_turn_the_next_has_the_difference() -> None:
    motion = fed((0, 0), (100, 10), (200, 14))
    assert motion.turn_to(0) == STILL
    assert degrees(motion, 100) == pytest.approx(10)
    assert degrees(motion, 200) == pytest.approx(4)


def test_it_interpolates_to_the_stamp_of_the_frame() -> None:
    # 0 to 10 degrees in 100 ms: 2.5 at 25 ms; 12 at 150 ms.
    motion = fed((0, 0), (100, 10), (200, 14))
    motion.turn_to(25 * MS)
    assert degrees(motion, 150) == pytest.approx(12 - 2.5)


def test_the_shorter_way_across_the_cut() -> None:
    motion = fed((0, 178), (100, -176), (200, -170))
    motion.turn_to(0)
    assert degrees(motion, 100) == pytest.approx(6)
    assert degrees(motion, 200) == pytest.approx(6)


def test_samples_in_any_order() -> None:
    ordered, mixed = fed((0, 0), (100, 10), (200, 14)), fed((0, 0), (200, 14), (100, 10))
    for motion in (ordered, mixed):
        motion.turn_to(0)
    assert degrees(mixed, 150) == pytest.approx(degrees(ordered, 150))


def test_a_late_stream_is_predicted_and_made_good_later() -> None:
    # 10 degrees in 100 ms; at 150 ms it should be 15. It was 11 at 150 ms: the next turn is less.
    motion = fed((0, 0), (50, 5), (100, 10))
    motion.turn_to(100 * MS)
    guess = motion.turn_to(150 * MS)
    assert math.degrees(guess.rad) == pytest.approx(5)
    # 2 rad/s^2 for 50 ms alone: 2 * 0.05^2 / 2.
    assert guess.sigma_rad == pytest.approx(0.0025)
    assert motion.counters["turns_guessed"] == 1
    motion.add(told(150, 11))
    motion.add(told(200, 12))
    assert degrees(motion, 200) == pytest.approx(12 - 15)


def test_prediction_ends() -> None:
    # 100 degrees a second are believed to go on for half a second: to 60 degrees.
    motion = fed((0, 0), (50, 5), (100, 10))
    motion.turn_to(100 * MS)
    assert degrees(motion, 5_100) == pytest.approx(50)
    far = motion.turn_to(5_200 * MS)
    assert far.rad == pytest.approx(0.0)
    assert far.sigma_rad <= math.pi


def test_a_new_origin_is_recognised() -> None:
    # Steady 100 degrees a second; at 150 ms the robot says 150 degrees less than it should.
    motion = fed((0, 0), (50, 5), (100, 10), (150, -135), (200, -130))
    assert motion.counters["motion_jumps"] == 1
    motion.turn_to(100 * MS)
    assert degrees(motion, 200) == pytest.approx(10)


def test_duplicates_gaps_and_clock_resets_are_counted() -> None:
    motion = fed((0, 0), (0, 1), (600, 2))
    assert motion.counters["motion_duplicates"] == 1
    assert motion.counters["motion_gaps"] == 1
    motion = fed((5_000, 40), (100, 0), (200, 1))
    assert motion.counters["motion_clock_resets"] == 1
    motion.turn_to(100 * MS)
    assert degrees(motion, 200) == pytest.approx(1)


def test_what_lies_in_a_gap_is_a_guess() -> None:
    motion = fed((0, 0), (1_000, 20))
    motion.turn_to(0)
    assert motion.turn_to(400 * MS).sigma_rad == pytest.approx(2 * 0.4**2 / 2)


def test_without_odometry_there_is_no_turn() -> None:
    motion = fed()
    assert motion.turn_to(0) == STILL == motion.turn_to(100 * MS)
    assert motion.counters["turns_unknown"] == 2
    # Before the first sample nothing is known, either; the turn begins with the next frame.
    motion.add(told(200, 0))
    motion.add(told(300, 5))
    assert motion.turn_to(150 * MS) == motion.turn_to(200 * MS) == STILL
    assert degrees(motion, 300) == pytest.approx(5)


def test_waiting_is_bounded() -> None:
    motion = fed((0, 0), (100, 1), wait_s=0.03)
    assert motion.ready(100 * MS, waited_ns=0)
    assert not motion.ready(120 * MS, waited_ns=29 * MS)
    assert motion.ready(120 * MS, waited_ns=30 * MS)
    with pytest.raises(ValueError, match="wait_s: expected a finite number >= 0, got -1"):
        EgoMotion(TransformBufferConfig(), -1)


def test_old_samples_are_forgotten() -> None:
    motion = fed(*[(20 * k, 0.1 * k) for k in range(2_000)])
    motion.turn_to(39_900 * MS)
    assert degrees(motion, 39_960) == pytest.approx(0.3)
    assert motion.turn_to(10 * MS) == STILL  # long before what is kept
