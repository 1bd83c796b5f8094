"""Steps of feet whose walk is known: by hand, and of the virtual lab's people."""

import math

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lab.scenario import Waypoint, load_scenario
from lab.truth.motion_capture import footfalls
from lab.world import World
from people4d.messages import F64, GaitMeasures
from services.gait.config import StepConfig
from services.gait.steps.footprints import FootTrajectory
from services.gait.steps.steps import (
    FootStep,
    StepMeter,
    even_strides,
    find_steps,
    gait_measures,
)

UP = np.array([0.0, 0.0, 1.0])
CONFIG = StepConfig()
NOTHING = GaitMeasures()


def feet(
    times_s: F64, left_swing_s: float = 0.5, right_swing_s: float = 0.5, step_m: float = 0.6
) -> tuple[F64, F64]:
    """Return feet 20 cm apart that swing one after the other along x, the right one first.

    While one swings, by two steps at an even speed, the other stands.
    """
    cycle_s = left_swing_s + right_swing_s
    done = np.floor(times_s / cycle_s)
    phase_s = times_s - done * cycle_s
    right = np.clip(phase_s / right_swing_s, 0, 1)
    left = np.clip((phase_s - right_swing_s) / left_swing_s, 0, 1)
    zero = np.zeros_like(times_s)
    return (
        np.stack([2 * step_m * (done + left), zero + 0.2, zero], axis=1),
        np.stack([2 * step_m * (done + right) - step_m, zero, zero], axis=1),
    )


def found_steps(left: F64, right: F64, times_s: F64, up: F64 = UP) -> list[FootStep]:
    return find_steps(FootTrajectory(times_s, left), FootTrajectory(times_s, right), up, CONFIG)


def measured(left: F64, right: F64, times_s: F64, up: F64 = UP) -> GaitMeasures:
    return gait_measures(found_steps(left, right, times_s, up), CONFIG)


def test_an_even_walk_by_hand() -> None:
    # 0.6 m in 0.5 s: 120 steps a minute, 1.2 m/s, and a foot moves by 1.2 m in a stride.
    times_s = np.arange(0, 6, 1 / 30)
    found = measured(*feet(times_s), times_s)
    # Feet come down at 0.5, 1.0, ... 5.5 s; those standing in the first frame did not land.
    # From the third on each ends a stride.
    assert found.steps == 9
    assert found.step_length_m == pytest.approx(0.6, abs=0.005)
    assert found.stride_length_m == pytest.approx(1.2, abs=0.01)
    assert found.cadence_per_min == pytest.approx(120, abs=1)
    assert found.walking_speed_mps == pytest.approx(1.2, abs=0.02)
    assert found.step_time_asymmetry == pytest.approx(0, abs=0.02)


def test_a_limp_by_hand() -> None:
    # The left foot takes 0.6 s, the right one 0.4 s: (0.6 - 0.4) / 0.5 = 0.4; 120 steps a minute.
    times_s = np.arange(0, 6, 1 / 30)
    found = measured(*feet(times_s, left_swing_s=0.6, right_swing_s=0.4), times_s)
    assert found.step_time_asymmetry == pytest.approx(0.4, abs=0.06)
    assert found.cadence_per_min == pytest.approx(120, abs=2)


def test_a_limp_of_unlike_lengths_by_hand() -> None:
    # 0.7 m to the left foot, 0.5 m to the right one: a stride is 1.2 m, the mean step 0.6 m.
    times_s = np.arange(0, 6, 1 / 30)
    left, right = feet(times_s)
    steps = found_steps(left + np.array([0.1, 0, 0]), right, times_s)
    lengths = {(step.foot, round(step.length_m, 2)) for step in steps}
    assert lengths == {("left", 0.7), ("right", 0.5)}
    assert gait_measures(steps, CONFIG).step_length_m == pytest.approx(0.6, abs=0.005)


def test_exchanged_feet_give_the_same_measures() -> None:
    """Point filters exchange feet at times, most of all where they pass."""
    times_s = np.arange(0, 6, 1 / 30)
    left, right = feet(times_s)
    taken = (np.random.default_rng(2).random(len(times_s)) < 0.4)[:, None]
    found = measured(np.where(taken, right, left), np.where(taken, left, right), times_s)
    assert found == measured(left, right, times_s)


def test_noise_gaps_and_exchanged_feet_change_measures_little() -> None:
    # 0.6 m in 0.5 s, 5 cm of noise; a tenth of the samples is absent, in a fifth of the frames
    # feet are exchanged.
    generator, times_s = np.random.default_rng(4), np.arange(0, 8, 1 / 30)
    both = np.stack(feet(times_s))
    both += generator.normal(0, 0.05, both.shape)
    taken = generator.random(len(times_s)) < 0.2
    both[:, taken] = both[::-1, taken]
    visible = generator.random(both.shape[:2]) > 0.1
    left, right = (FootTrajectory(times_s[visible[k]], both[k, visible[k]]) for k in (0, 1))
    found = gait_measures(find_steps(left, right, UP, CONFIG), CONFIG)
    assert found.step_length_m == pytest.approx(0.6, abs=0.02)
    assert found.cadence_per_min == pytest.approx(120, rel=0.03)


def test_missed_footprint_gives_no_long_step() -> None:
    # The right foot comes down at 0.5, 1.5, ... s; where it stands from 2.5 to 3.0 s nothing sees
    # it. Left footprints on both sides of it are a stride; without the one halfway that
    # is not known to be one, and the steps there are 1.5 s long for nothing.
    times_s = np.arange(0, 6, 1 / 30)
    left, right = feet(times_s)
    visible = (times_s < 2.3) | (times_s > 3.2)
    steps = find_steps(
        FootTrajectory(times_s, left), FootTrajectory(times_s[visible], right[visible]), UP, CONFIG
    )
    assert [s.length_m for s in steps] == pytest.approx([0.6] * len(steps), abs=0.02)
    assert not [s for s in steps if s.stride and s.stride.time_s > 1.1]
    assert gait_measures(steps, CONFIG).cadence_per_min == pytest.approx(120, abs=2)


def test_one_foot_alone_gives_no_measures() -> None:
    """Its footprints count as those of both feet, at half the rate."""
    times_s = np.arange(0, 6, 1 / 30)
    left, _ = feet(times_s)
    nothing = np.zeros((0, 3))
    assert (
        find_steps(FootTrajectory(times_s, left), FootTrajectory(times_s[:0], nothing), UP, CONFIG)
        == []
    )
    assert measured(left, left, times_s) == NOTHING


def test_turn_round_gives_no_false_stride() -> None:
    # Six steps along x, a second of standing, and the same steps back: no step joins both ways.
    there_s = np.arange(0, 3.5, 1 / 30)
    left, right = feet(there_s)
    stand = np.repeat([[left[-1]], [right[-1]]], 30, axis=1)
    left = np.concatenate([left, stand[0], left[::-1]])
    right = np.concatenate([right, stand[1], right[::-1]])
    times_s = np.arange(len(left)) / 30
    steps = found_steps(left, right, times_s)
    assert [step.length_m for step in steps] == pytest.approx([0.6] * len(steps), abs=0.02)
    found = gait_measures(steps, CONFIG)
    assert found.step_length_m == pytest.approx(0.6, abs=0.005)
    assert found.cadence_per_min == pytest.approx(120, abs=2)


def test_steps_are_assigned_to_left_and_right() -> None:
    times_s = np.arange(0, 4, 1 / 30)
    left, right = feet(times_s)
    steps = found_steps(left, right, times_s)
    # Right feet come down at 0.5, 1.5, ... s, left ones at 1.0, 2.0, ... s.
    for step in steps:
        expected_s = (
            round(step.landed_s) if step.foot == "left" else math.floor(step.landed_s) + 0.5
        )
        assert step.landed_s == pytest.approx(expected_s, abs=0.05)
    # The first one, at 0.5 s, came from where nothing saw it stand.
    assert [step.foot for step in steps[:4]] == ["left", "right", "left", "right"]


def test_the_frame_does_not_matter() -> None:
    """A camera's frame has its own axes: down is not -z there."""
    times_s = np.arange(0, 5, 1 / 30)
    left, right = feet(times_s)
    turn = Rotation.from_rotvec((1.0, 0.4, -0.7)).as_matrix()
    here = measured(left, right, times_s)
    there = measured(left @ turn.T + 3, right @ turn.T + 3, times_s, turn @ UP)
    assert here.step_length_m == pytest.approx(there.step_length_m)
    assert here.cadence_per_min == pytest.approx(there.cadence_per_min)


def test_constant_offset_of_a_foot_does_not_change_lengths() -> None:
    """From the front the toes of one foot are visible and the heel of the other."""
    times_s = np.arange(0, 6, 1 / 30)
    left, right = feet(times_s)
    found = measured(left + np.array([0.06, 0, 0]), right, times_s)
    assert found.step_length_m == pytest.approx(0.6, abs=0.01)
    assert found.cadence_per_min == pytest.approx(120, abs=1)


def test_standing_person_has_no_steps() -> None:
    generator = np.random.default_rng(1)
    times_s = np.arange(0, 6, 1 / 30)
    still = np.zeros((len(times_s), 3))
    noise = generator.normal(0, 0.05, (2, *still.shape))
    assert measured(still + np.array([0, 0.2, 0]) + noise[0], still + noise[1], times_s) == NOTHING


def test_stepping_on_the_spot_gives_no_measures() -> None:
    times_s = np.arange(0, 6, 1 / 30)
    up_and_down = 0.2 * np.abs(np.sin(2 * np.pi * times_s))
    zero = np.zeros_like(times_s)
    left = np.stack([zero, zero + 0.2, up_and_down], axis=1)
    right = np.stack([zero, zero, 0.2 - up_and_down], axis=1)
    assert measured(left, right, times_s) == NOTHING


def test_few_steps_give_no_measures() -> None:
    times_s = np.arange(0, 1.6, 1 / 30)
    assert measured(*feet(times_s), times_s) == NOTHING


@pytest.mark.parametrize("count", [0, 1, 3])
def test_few_samples_give_no_steps(count: int) -> None:
    points = np.zeros((count, 3))
    assert measured(points, points, np.arange(count) / 30.0) == NOTHING


def test_steps_before_and_after_an_occlusion_are_not_joined() -> None:
    # From 2.2 to 4.1 s nothing sees the left foot: steps of that time are none, and no long one.
    times_s = np.arange(0, 7, 1 / 30)
    left, right = feet(times_s)
    visible = (times_s < 2.2) | (times_s > 4.1)
    steps = find_steps(
        FootTrajectory(times_s[visible], left[visible]), FootTrajectory(times_s, right), UP, CONFIG
    )
    assert not [s for s in steps if 2.3 < s.landed_s < 4.0]
    assert [s.length_m for s in steps] == pytest.approx([0.6] * len(steps), abs=0.03)
    assert gait_measures(steps, CONFIG).cadence_per_min == pytest.approx(120, abs=4)


def test_meter_deletes_old_steps_of_a_standing_person() -> None:
    meter, config = StepMeter(CONFIG, UP), CONFIG
    times_s = np.arange(0, 5, 1 / 15)
    for time_s, left, right in zip(times_s, *feet(times_s), strict=True):
        walked = meter.update(float(time_s), left, right)
    assert walked.cadence_per_min == pytest.approx(120, abs=3)
    for time_s in np.arange(5, 5 + config.window_s, 1 / 15):
        stood = meter.update(float(time_s), left, right)
    assert stood == NOTHING


def test_meter_ignores_old_stamps_and_unmeasured_feet() -> None:
    meter = StepMeter(CONFIG, UP)
    point = np.zeros(3)
    for stamp_s in (3.0, 2.0, 3.0, 3.1):
        assert meter.update(stamp_s, point, None) == NOTHING


def lab_walk() -> World:
    """Return a world in which a person walks across the room in a straight line."""
    scenario = load_scenario("short_walk")
    person = msgspec.structs.replace(
        scenario.people[0], start=(4.6, 1.4), path=(Waypoint(to=(1.2, -1.4)),), face_deg=-140.0
    )
    return World(msgspec.structs.replace(scenario, duration_s=4.5, people=(person,)))


@pytest.mark.parametrize(
    ("noise_m", "rate_hz", "occluded"), [(0.0, 30, 0.0), (0.04, 30, 0.1), (0.04, 15, 0.2)]
)
def test_steps_of_the_lab(noise_m: float, rate_hz: float, occluded: float) -> None:
    """True: where and when the planned feet come down."""
    world, generator = lab_walk(), np.random.default_rng(5)
    times_s = np.arange(0, 4.5, 1 / rate_hz)
    ankles = np.array([world.keypoints_m(float(t))[0][15:17] for t in times_s])
    ankles += generator.normal(0, noise_m, ankles.shape)
    visible = generator.random((2, len(times_s))) >= occluded
    paths = [FootTrajectory(times_s[visible[k]], ankles[visible[k], k]) for k in (0, 1)]
    steps = find_steps(paths[0], paths[1], UP, CONFIG)
    falls = footfalls(world, 0)
    ends = [
        min(range(len(falls)), key=lambda k: abs(falls[k].time_s - step.landed_s))
        for step, _ in even_strides(steps, CONFIG)
    ]
    assert len(set(ends)) == len(ends) >= 3
    lengths_m = [np.linalg.norm(falls[k].position_m - falls[k - 2].position_m) / 2 for k in ends]
    times = [(falls[k].time_s - falls[k - 2].time_s) / 2 for k in ends]
    found = gait_measures(steps, CONFIG)
    assert found.step_length_m == pytest.approx(float(np.mean(lengths_m)), abs=0.02)
    assert found.cadence_per_min == pytest.approx(60 / float(np.mean(times)), rel=0.03)


@pytest.mark.parametrize(
    ("field", "value"), [("gap_s", 0.0), ("window_s", math.inf), ("strides_min", 1)]
)
def test_invalid_configuration_is_refused(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        msgspec.structs.replace(CONFIG, **{field: value})
