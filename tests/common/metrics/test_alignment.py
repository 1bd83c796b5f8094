"""Clock and frame of the truth: moved as known, and found again from tracks."""

import math
from collections.abc import Callable, Hashable

import numpy as np
import pytest

from common.geometry.transforms import apply, invert, rotation_from_rpy, transform_from
from common.metrics.alignment.alignment import (
    estimate_clock,
    estimate_motion,
    fit_2d,
    fit_3d,
    transform_truth,
)
from common.metrics.alignment.trajectories import Trajectory
from people4d.messages import F64, Truth, TruthPerson
from tests import builders

RATE_HZ, FRAMES_HZ = 100.0, 30.0


def path(position: Callable[[F64], list[F64]], rate_hz: float, late_s: float = 0.0) -> Trajectory:
    """A walk of 5 s as detected by a clock that is late."""
    t = np.arange(0.0, 5.0, 1.0 / rate_hz)
    x, y = position(t)
    return Trajectory(t + late_s, np.column_stack([x, y, np.full(len(t), 1.0)]))


def left(t: F64) -> list[F64]:
    return [3.0 + 0 * t, 2.0 - 0.8 * t]


def right(t: F64) -> list[F64]:
    return [3.6 + 0 * t, -2.0 + 0.8 * t]


def bent(t: F64) -> list[F64]:
    return [3.0 + np.sin(t), 1.2 * np.cos(t)]


def crossing(offset_s: float) -> tuple[dict[Hashable, Trajectory], dict[Hashable, Trajectory]]:
    """Two crossing people; the truth's clock is `offset_s` behind the camera's."""
    truth: dict[Hashable, Trajectory] = {
        "a": path(left, RATE_HZ, -offset_s),
        "b": path(right, RATE_HZ, -offset_s),
    }
    tracked: dict[Hashable, Trajectory] = {1: path(left, FRAMES_HZ), 2: path(right, FRAMES_HZ)}
    return truth, tracked


def shifted(paths: dict[Hashable, Trajectory], by_m: F64) -> dict[Hashable, Trajectory]:
    return {k: Trajectory(p.stamps_s, p.positions_m + by_m) for k, p in paths.items()}


@pytest.mark.parametrize("offset_s", [0.08, -0.08, 0.0, 0.31, -0.5])
def test_an_exact_crossing_gives_the_exact_offset(offset_s: float) -> None:
    got = estimate_clock(*crossing(offset_s))
    assert got is not None
    assert got.offset_s == pytest.approx(offset_s, abs=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_80_ms_are_found_within_5_ms_in_noise_and_with_a_bias(seed: int) -> None:
    # Depth reads the near side of a body: all tracks are 0.13 m nearer to the camera.
    truth, tracked = crossing(0.08)
    rng = np.random.default_rng(seed)
    noisy = {
        k: Trajectory(p.stamps_s, p.positions_m + rng.normal(0.0, 0.02, p.positions_m.shape))
        for k, p in shifted(tracked, np.array([-0.13, 0.0, 0.0])).items()
    }
    got = estimate_clock(truth, noisy)
    assert got is not None
    assert got.offset_s == pytest.approx(0.08, abs=0.005)
    # 300 samples of 0.02 m at 0.8 m/s either way: 0.02 / (0.8 sqrt(300)) = 1.44 ms.
    assert got.sigma_s == pytest.approx(0.00144, abs=0.0003)


def test_tracks_that_swap_where_people_meet_do_not_mislead() -> None:
    truth, tracked = crossing(0.08)
    one, two = tracked[1], tracked[2]
    half = len(one.stamps_s) // 2
    tracked[1] = Trajectory(
        one.stamps_s, np.vstack([one.positions_m[:half], two.positions_m[half:]])
    )
    tracked[2] = Trajectory(
        one.stamps_s, np.vstack([two.positions_m[:half], one.positions_m[half:]])
    )
    got = estimate_clock(truth, tracked)
    assert got is not None
    assert got.offset_s == pytest.approx(0.08, abs=1e-6)


def test_one_straight_walk_gives_no_offset() -> None:
    truth, tracked = {"a": path(left, RATE_HZ)}, {1: path(left, FRAMES_HZ)}
    assert estimate_clock(truth, tracked) is None  # later or farther to the left: the same tracks


def test_one_bent_walk_can() -> None:
    truth, tracked = {"a": path(bent, RATE_HZ, -0.08)}, {1: path(bent, FRAMES_HZ)}
    got = estimate_clock(truth, tracked)
    assert got is not None
    assert got.offset_s == pytest.approx(0.08, abs=1e-3)


def test_nothing_gives_nothing() -> None:
    truth, tracked = crossing(0.0)
    assert estimate_clock({}, {}) is None
    assert estimate_clock(truth, {}) is None
    assert estimate_clock({}, tracked) is None
    assert estimate_motion({}, tracked) is None
    assert estimate_clock(truth, shifted(tracked, np.array([50.0, 0.0, 0.0]))) is None


def test_a_quarter_turn_by_hand() -> None:
    # (1, 0) to (5, 3) and (2, 0) to (5, 4): +x becomes +y, then (0, 0) lies at (5, 2).
    got = fit_2d(np.array([[1.0, 0, 0], [2.0, 0, 0]]), np.array([[5.0, 3, 1], [5.0, 4, 1]]))
    assert got == pytest.approx(np.array([[0, -1, 0, 5], [1, 0, 0, 2], [0, 0, 1, 1], [0, 0, 0, 1]]))


@pytest.mark.parametrize("seed", range(5))
def test_a_rigid_motion_is_found_exactly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(20, 3))
    flat = transform_from(rng.normal(size=3), rotation_from_rpy(0, 0, rng.uniform(-3, 3)))
    full = transform_from(rng.normal(size=3), rotation_from_rpy(*rng.uniform(-1.5, 1.5, 3)))
    assert fit_2d(points, apply(flat, points)) == pytest.approx(flat, abs=1e-12)
    assert fit_3d(points, apply(full, points)) == pytest.approx(full, abs=1e-12)
    assert np.linalg.det(fit_3d(points, -points)[:3, :3]) == pytest.approx(1.0)  # never a mirror


def test_the_frame_of_the_truth_is_found_from_tracks() -> None:
    truth, tracked = crossing(0.08)
    wrong = transform_from([0.3, -0.2, 0.0], rotation_from_rpy(0.0, 0.0, math.radians(4)))
    misplaced = {
        k: Trajectory(p.stamps_s, apply(invert(wrong), p.positions_m)) for k, p in truth.items()
    }
    got = estimate_motion(misplaced, tracked, offset_s=0.08)
    assert got is not None
    assert got.matrix == pytest.approx(wrong, abs=1e-9)
    assert got.rmse_before_m > 0.2
    assert got.rmse_after_m < 1e-9


def test_a_tilted_frame_needs_three_dimensions_and_people_off_one_line() -> None:
    truth, tracked = crossing(0.0)
    tilt = transform_from([0.1, 0.0, 0.0], rotation_from_rpy(0.0, math.radians(2), 0.0))
    tilted = {
        k: Trajectory(p.stamps_s, apply(invert(tilt), p.positions_m)) for k, p in truth.items()
    }
    got = estimate_motion(tilted, tracked, dimensions=3)
    assert got is not None
    assert got.matrix == pytest.approx(tilt, abs=1e-9)
    # One straight walk can be turned about itself.
    assert estimate_motion({"a": tilted["a"]}, {1: tracked[1]}, dimensions=3) is None
    assert estimate_motion({"a": tilted["a"]}, {1: tracked[1]}, dimensions=2) is not None


def test_people_who_stand_still_give_no_rotation() -> None:
    still = {"a": Trajectory(np.arange(0, 5, 0.01), np.ones((500, 3)))}
    tracked = {1: Trajectory(np.arange(0, 5, 0.1), np.ones((50, 3)))}
    assert estimate_motion(still, tracked) is None


def test_moved_by_hand() -> None:
    # A quarter turn to the left about z and one metre up.
    turn = transform_from([0.0, 0.0, 1.0], rotation_from_rpy(0.0, 0.0, math.pi / 2))
    person = TruthPerson(
        id="a",
        position_m=np.array([2.0, 0.0, 1.0]),
        velocity_mps=np.array([0.0, 1.0, 0.0]),
        yaw_rad=math.radians(170),
    )
    truth = Truth(stamp_ns=5, sequence=3, frame_id="mocap", people=(person,))
    got = transform_truth(truth, turn, "map")
    assert (got.frame_id, got.stamp_ns, got.sequence) == ("map", 5, 3)
    (one,) = got.people
    assert one.position_m == pytest.approx(np.array([0.0, 2.0, 2.0]))
    assert one.velocity_mps == pytest.approx(np.array([-1.0, 0.0, 0.0]))
    assert one.yaw_rad == pytest.approx(math.radians(-100))  # 260
    assert one.path_yaw_rad is None


def test_mocap_with_another_axis_up_turns_yaw_rightly() -> None:
    # A frame upside down (half a turn about x): facing +y there is facing -y here.
    over = transform_from([0.0, 0.0, 0.0], rotation_from_rpy(math.pi, 0.0, 0.0))
    person = builders.truth_person(yaw_rad=math.pi / 2)
    truth = builders.truth(person, frame_id="mocap")
    assert transform_truth(truth, over, "map").people[0].yaw_rad == pytest.approx(-math.pi / 2)
