"""Steps of feet whose walk is known: by hand, and of the virtual lab's people."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from lab.catalogue import load_scenario
from lab.scenario import Waypoint
from lab.truth.motion_capture import footfalls
from lab.world import World
from people4d.messages import F64, GaitMeasures
from services.gait.config import StepConfig
from services.gait.steps.step_meter import PointSample, StepMeter
from services.gait.steps.steps import (
    FootStep,
    PointTrajectory,
    cadence,
    find_steps,
    gait_measures,
    walked_strides,
)

CONFIG = StepConfig()
NOISE_M2 = 0.02**2 * np.eye(3)
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


def trajectory(times_s: F64, points_m: F64) -> PointTrajectory:
    return PointTrajectory(times_s, points_m, np.tile(NOISE_M2, (len(times_s), 1, 1)))


def body(times_s: F64, left: F64, right: F64) -> PointTrajectory:
    """Return a body midway between both feet."""
    return trajectory(times_s, (left + right) / 2)


def found_steps(left: F64, right: F64, times_s: F64) -> list[FootStep]:
    feet = trajectory(times_s, left), trajectory(times_s, right)
    return find_steps(body(times_s, left, right), *feet)


def measured(left: F64, right: F64, times_s: F64) -> GaitMeasures:
    return gait_measures(found_steps(left, right, times_s))


@pytest.mark.parametrize(("step_s", "counts"), [(0.28, False), (0.33, True)])
def test_strides_of_less_than_six_tenths_of_a_second_do_not_count(
    step_s: float, counts: bool
) -> None:
    times_s = np.arange(0, 4, 1 / 60)
    strides = [s.stride for s in found_steps(*feet(times_s, step_s, step_s), times_s)]
    assert any(strides) == counts


def test_an_even_walk_by_hand() -> None:
    # 0.6 m in 0.5 s: 120 steps a minute, 1.2 m/s, and a foot moves by 1.2 m in a stride.
    times_s = np.arange(0, 6, 1 / 30)
    found = measured(*feet(times_s), times_s)
    # Feet land at 0.5, 1.0, ... 5.5 s, and the right one swings in the first frame already.
    assert found.steps == 11
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
    for step in steps:
        assert step.length_m == pytest.approx(0.7 if step.foot == "left" else 0.5, abs=0.015)
    assert gait_measures(steps).step_length_m == pytest.approx(0.6, abs=0.005)


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_noise_and_gaps_change_measures_little(seed: int) -> None:
    # 0.6 m in 0.5 s, 5 cm of noise; a tenth of the samples is absent.
    generator, times_s = np.random.default_rng(seed), np.arange(0, 8, 1 / 30)
    both = np.stack(feet(times_s))
    middle = body(times_s, *both)
    both += generator.normal(0, 0.05, both.shape)
    visible = generator.random(both.shape[:2]) > 0.1
    left, right = (trajectory(times_s[visible[k]], both[k, visible[k]]) for k in (0, 1))
    found = gait_measures(find_steps(middle, left, right))
    assert found.step_length_m == pytest.approx(0.6, abs=0.02)
    assert found.cadence_per_min == pytest.approx(120, rel=0.03)


def test_missed_footprint_gives_no_long_step() -> None:
    # The right foot lands at 0.5, 1.5, ... s and is not visible where it stands from 2.5 to 3.0 s.
    # This step is unknown; steps of the left foot have half a stride as length.
    times_s = np.arange(0, 6, 1 / 30)
    left, right = feet(times_s)
    visible = (times_s < 2.3) | (times_s > 3.2)
    steps = find_steps(
        body(times_s, left, right),
        trajectory(times_s, left),
        trajectory(times_s[visible], right[visible]),
    )
    assert [s.length_m for s in steps] == pytest.approx([0.6] * len(steps), abs=0.02)
    assert not [s for s in steps if s.stride and s.stride.time_s > 1.1]
    assert gait_measures(steps).cadence_per_min == pytest.approx(120, abs=2)


def test_unseen_foot_steps_between_two_landings_of_the_other() -> None:
    times_s = np.arange(0, 6, 1 / 30)
    left, right = feet(times_s)
    nothing = trajectory(times_s[:0], right[:0])
    steps = find_steps(body(times_s, left, right), trajectory(times_s, left), nothing)
    assert {(step.foot, step.observed) for step in steps} == {("left", True), ("right", False)}
    assert gait_measures(steps).cadence_per_min == pytest.approx(120, abs=2)


def test_keypoints_of_the_other_leg_change_no_step() -> None:
    # The right foot is on the left one for a fifth of the frames.
    times_s = np.arange(0, 6, 1 / 30)
    left, right = feet(times_s)
    expected = found_steps(left, right, times_s)
    wrong = np.where(np.random.default_rng(3).random((len(times_s), 1)) < 0.2, left, right)
    paths = trajectory(times_s, left), trajectory(times_s, wrong)
    found = find_steps(body(times_s, left, right), *paths)
    assert [one.foot for one in found] == [one.foot for one in expected]
    off_s = [a.landed_s - b.landed_s for a, b in zip(found, expected, strict=True)]
    assert np.abs(off_s).max() < 0.1


def test_turn_round_changes_measures_little() -> None:
    # Six steps along x, two steps of a turn on the spot, and six steps back.
    there_s = np.arange(0, 3, 1 / 30)
    there = np.array(feet(there_s))
    back = np.array((3.0, 0.2, 0.0)) - there
    turned = np.linspace(there[:, -1], back[:, 0], 15, axis=1)
    stands = [np.repeat(one[:, :1], 15, axis=1) for one in (there[:, -1:], back)]
    turned = np.stack(
        [np.concatenate([stands[0][0], turned[0]]), np.concatenate([turned[1], stands[1][1]])]
    )
    left, right = np.concatenate([there, turned, back], axis=1)
    times_s = np.arange(len(left)) / 30
    steps = found_steps(left, right, times_s)
    found = gait_measures(steps)
    assert found.step_length_m == pytest.approx(0.6, abs=0.03)
    assert found.cadence_per_min == pytest.approx(120, abs=4)


def test_short_strides_of_a_turn_count_in_the_mean_length() -> None:
    # 0.6 m a step for 4 s, then 0.25 m: strides of 1.2 m and, after one of 0.85 m, of 0.5 m.
    times_s = np.arange(0, 8, 1 / 30)
    long, short = feet(np.minimum(times_s, 4)), feet(np.maximum(times_s - 4, 0), step_m=0.25)
    left, right = (a + b - b[0] for a, b in zip(long, short, strict=True))
    right[:, 0] += 0.35 * np.clip((times_s - 4) / 0.5, 0, 1)  # passes the left foot
    steps = found_steps(left, right, times_s)
    lengths_m = [step.stride.length_m for step in steps if step.stride]
    assert min(lengths_m) < 0.55 < 1.0 < max(lengths_m)
    found = gait_measures(steps)
    assert found.stride_length_m == pytest.approx(np.mean(lengths_m), abs=0.02)


def test_strides_of_unsure_footprints_count_less() -> None:
    times_s = np.arange(0, 6, 1 / 30)
    steps = found_steps(*feet(times_s), times_s)
    last = steps[-1]
    assert last.stride is not None
    count = len(walked_strides(steps))
    unsure = replace(last.stride, length_m=0.8, confidence=0.3)
    found = gait_measures([*steps[:-1], replace(last, stride=unsure)])
    expected_m = (1.2 * (count - 1) + 0.3 * 0.8) / (count - 1 + 0.3)
    assert found.stride_length_m == pytest.approx(expected_m, abs=0.005)


def test_confidence_of_a_stride_is_that_of_its_less_certain_footprint() -> None:
    times_s = np.arange(0, 6, 1 / 30)
    steps = found_steps(*feet(times_s), times_s)
    for own, step in zip(steps, steps[2:], strict=False):
        if step.stride is not None:
            assert step.stride.confidence == min(own.confidence, step.confidence)


def test_strides_with_a_pause_do_not_count() -> None:
    # A stand of 1.2 s at 3.5 s: the stride in which it is takes 2.2 s, all others 1 s.
    times_s = np.arange(0, 9, 1 / 30)
    walked_s = np.where(times_s < 3.5, times_s, np.maximum(times_s - 1.2, 3.5))
    steps = found_steps(*feet(walked_s), times_s)
    strides_s = [stride.time_s for _, stride in walked_strides(steps)]
    assert len(strides_s) >= 4
    assert max(strides_s) < 1.4


def test_steps_are_assigned_to_left_and_right() -> None:
    times_s = np.arange(0, 4, 1 / 30)
    left, right = feet(times_s)
    steps = found_steps(left, right, times_s)
    # Right feet land at 0.5, 1.5, ... s, left ones at 1.0, 2.0, ... s.
    for step in steps:
        expected_s = (
            round(step.landed_s) if step.foot == "left" else math.floor(step.landed_s) + 0.5
        )
        assert step.landed_s == pytest.approx(expected_s, abs=0.05)
    assert [step.foot for step in steps[:4]] == ["right", "left", "right", "left"]


def test_direction_of_the_walk_does_not_matter() -> None:
    times_s = np.arange(0, 5, 1 / 30)
    left, right = feet(times_s)
    turn = Rotation.from_rotvec((0.0, 0.0, 2.1)).as_matrix()
    here = measured(left, right, times_s)
    there = measured(left @ turn.T + 3, right @ turn.T + 3, times_s)
    assert here.step_length_m == pytest.approx(there.step_length_m)
    assert here.cadence_per_min == pytest.approx(there.cadence_per_min)


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
    # The right foot lands at 0.5 s, the left one at 1 s, the right one at 1.5 s: a stride.
    times_s = np.arange(0, 1.3, 1 / 30)
    found = measured(*feet(times_s), times_s)
    assert (found.steps, found.step_length_m) == (2, None)
    times_s = np.arange(0, 1.8, 1 / 30)
    found = measured(*feet(times_s), times_s)
    assert found.steps == 3
    assert found.step_length_m == pytest.approx(0.6, abs=0.01)


@pytest.mark.parametrize("rate_hz", [10, 15, 30, 60])
def test_noise_in_depth_is_no_step(rate_hz: int) -> None:
    """People walk across a camera that sees along y: correlated noise of 8 cm."""
    times_s, generator = np.arange(0, 8, 1 / rate_hz), np.random.default_rng(6)
    covariances = np.tile(np.diag([0.02, 0.08, 0.02]) ** 2, (len(times_s), 1, 1))
    paths = []
    middle = body(times_s, *feet(times_s))
    for points in feet(times_s):
        white = generator.normal(0, 1, (len(times_s), 3)) * (0.02, 0.08, 0.02)
        ratio = math.exp(-1 / rate_hz / 0.1)
        noise = lfilter([math.sqrt(1 - ratio**2)], [1, -ratio], white, axis=0)
        paths.append(PointTrajectory(times_s, points + noise, covariances))
    steps = find_steps(middle, paths[0], paths[1])
    assert len(steps) == pytest.approx(15, abs=1)
    found = gait_measures(steps)
    assert found.step_length_m == pytest.approx(0.6, abs=0.03)
    assert found.cadence_per_min == pytest.approx(120, rel=0.03)


def test_swing_that_has_not_ended_is_no_step() -> None:
    times_s = np.arange(0, 2.45, 1 / 30)
    steps = found_steps(*feet(times_s), times_s)
    assert max(step.landed_s for step in steps) == pytest.approx(2.0, abs=0.1)


def test_swing_of_a_hidden_foot_is_found_by_its_footprints() -> None:
    # The left foot is hidden while it swings from 2.5 to 3 s, as behind the other leg.
    times_s = np.arange(0, 6, 1 / 30)
    left, right = feet(times_s)
    visible = (times_s < 2.55) | (times_s > 2.95)
    steps = find_steps(
        body(times_s, left, right),
        trajectory(times_s[visible], left[visible]),
        trajectory(times_s, right),
    )
    hidden = [s for s in steps if s.foot == "left" and 2.5 < s.landed_s < 3.1]
    assert [s.length_m for s in hidden] == [pytest.approx(0.6, abs=0.03)]
    assert hidden[0].confidence < max(s.confidence for s in steps)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_few_samples_give_no_steps(count: int) -> None:
    points = np.zeros((count, 3))
    assert measured(points, points, np.arange(count) / 30.0) == NOTHING


def test_step_of_an_occluded_foot_is_between_two_of_the_other() -> None:
    # From 2.2 to 4.1 s the left foot is not visible. The right foot lands at 2.5 and 3.5 s, so the
    # left foot must have landed between them, at 3.0 s.
    times_s = np.arange(0, 7, 1 / 30)
    left, right = feet(times_s)
    visible = (times_s < 2.2) | (times_s > 4.1)
    steps = find_steps(
        body(times_s, left, right),
        trajectory(times_s[visible], left[visible]),
        trajectory(times_s, right),
    )
    assert {s.foot for s in steps if 2.3 < s.landed_s < 3.9 and s.observed} == {"right"}
    unobserved = [(s.foot, s.landed_s) for s in steps if not s.observed]
    assert {foot for foot, _ in unobserved} == {"left"}
    assert any(landed_s == pytest.approx(3.0, abs=0.1) for _, landed_s in unobserved)
    assert [s.length_m for s in steps] == pytest.approx([0.6] * len(steps), abs=0.03)
    assert gait_measures(steps).cadence_per_min == pytest.approx(120, abs=4)


def test_meter_deletes_old_steps_of_a_standing_person() -> None:
    meter, config = StepMeter(CONFIG), CONFIG
    times_s = np.arange(0, 5, 1 / 15)
    for time_s, *points in zip(times_s, *feet(times_s), strict=True):
        samples = [PointSample(point, NOISE_M2) for point in (sum(points) / 2, *points)]
        walked = meter.add_frame(float(time_s), *samples)
    assert walked.cadence_per_min == pytest.approx(120, abs=3)
    for time_s in np.arange(5, 5 + config.window_s, 1 / 15):
        stood = meter.add_frame(float(time_s), *samples)
    assert stood == NOTHING


def test_meter_ignores_old_stamps_and_unmeasured_feet() -> None:
    meter = StepMeter(CONFIG)
    point = PointSample(np.zeros(3), NOISE_M2)
    for stamp_s in (3.0, 2.0, 3.0, 3.1):
        assert meter.add_frame(stamp_s, point, point, None) == NOTHING


def lab_walk() -> World:
    """Return a world in which a person walks across the room in a straight line."""
    scenario = load_scenario("short_walk")
    person = msgspec.structs.replace(
        scenario.people[0], start=(4.6, 1.4), path=(Waypoint(to=(1.2, -1.4)),), face_deg=-140.0
    )
    return World(msgspec.structs.replace(scenario, duration_s=4.5, people=(person,)))


@pytest.mark.parametrize(
    ("noise_m", "rate_hz", "occluded", "time_off"),
    [(0.0, 30, 0.0, 0.03), (0.04, 30, 0.1, 0.03), (0.04, 15, 0.2, 0.05)],
)
def test_steps_of_the_lab(noise_m: float, rate_hz: float, occluded: float, time_off: float) -> None:
    """True: where and when the planned feet land."""
    world, generator = lab_walk(), np.random.default_rng(5)
    times_s = np.arange(0, 4.5, 1 / rate_hz)
    ankles = np.array([world.keypoints_m(float(t))[0][15:17] for t in times_s])
    ankles += generator.normal(0, noise_m, ankles.shape)
    visible = generator.random((2, len(times_s))) >= occluded
    paths = [trajectory(times_s[visible[k]], ankles[visible[k], k]) for k in (0, 1)]
    middle = [world.keypoints_m(float(t))[0][11:13].mean(axis=0) for t in times_s]
    steps = find_steps(trajectory(times_s, np.array(middle)), *paths)
    falls = footfalls(world, 0)
    strides = [stride for _, stride in walked_strides(steps)]
    ends = [
        min(range(len(falls)), key=lambda k: abs(falls[k].time_s - step.landed_s))
        for step, _ in walked_strides(steps)
    ]
    assert len(set(ends)) == len(ends) >= 3
    # The first stride of a walk began before the first true step.
    both = [(stride, k) for stride, k in zip(strides, ends, strict=True) if k >= 2]
    lengths_m = [np.linalg.norm(falls[k].position_m - falls[k - 2].position_m) for _, k in both]
    times_s = np.array([falls[k].time_s - falls[k - 2].time_s for _, k in both])
    found_m = np.mean([stride.length_m for stride, _ in both])
    assert found_m / 2 == pytest.approx(float(np.mean(lengths_m)) / 2, abs=0.02)
    found_s = np.mean([stride.time_s for stride, _ in both])
    assert found_s == pytest.approx(float(times_s.mean()), rel=time_off)


@pytest.mark.parametrize(("field", "value"), [("every_s", 0.0), ("window_s", math.inf)])
def test_invalid_configuration_is_refused(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        msgspec.structs.replace(CONFIG, **{field: value})


def test_motion_of_a_frame_or_two_is_hardly_a_step() -> None:
    # A point that jumps past the other foot.
    times_s = np.arange(0, 4, 1 / 30)
    left, right = feet(np.zeros_like(times_s))
    left[times_s > 2, 0] += 0.7
    assert all(one.confidence < 0.5 for one in found_steps(left, right, times_s))


def test_brief_motions_of_a_walk_are_steps() -> None:
    # Points that stay at a footprint until their feet have landed at the next one.
    times_s = np.arange(0, 6, 1 / 30)
    left, right = feet(times_s)
    known = len(found_steps(left, right, times_s))
    for foot in (left, right):
        foot[1:] = np.where(np.diff(foot[:, :1], axis=0) > 1e-6, np.nan, foot[1:])
        for k in range(1, len(foot)):
            foot[k] = np.where(np.isfinite(foot[k]), foot[k], foot[k - 1])
    steps = found_steps(left, right, times_s)
    assert len(steps) >= known - 1
    assert all(one.confidence > 0.5 for one in steps if one.observed)


def test_landing_is_in_time_at_any_rate_and_phase() -> None:
    # Landings every 0.5 s, from 0.5 s on.
    for begin_s, rate_hz in ((0.0, 30), (0.013, 30), (0.02, 20), (0.0, 15), (0.03, 8), (0.0, 4)):
        times_s = np.arange(begin_s, 8, 1 / rate_hz)
        landed_s = [one.landed_s for one in found_steps(*feet(times_s), times_s)]
        off_s = np.array(landed_s) / 0.5 - np.round(np.array(landed_s) / 0.5)
        assert np.abs(off_s * 0.5).max() < 0.06, rate_hz


def test_frames_that_are_early_or_late_change_no_step() -> None:
    even_s = np.arange(0, 8, 0.1)
    times_s = even_s + np.random.default_rng(0).uniform(-0.02, 0.02, len(even_s))
    expected, found = (found_steps(*feet(times), times) for times in (even_s, times_s))
    assert [one.foot for one in found] == [one.foot for one in expected]
    off_s = [a.landed_s - b.landed_s for a, b in zip(found, expected, strict=True)]
    assert np.abs(off_s).max() < 0.1  # a frame


def test_samples_far_from_the_body_change_no_step() -> None:
    # Three samples of the right foot are 3 m aside.
    times_s = np.arange(0, 4, 0.25)
    left, right = feet(times_s)
    expected = found_steps(left, right, times_s)
    far = right + 3.0 * np.isin(np.arange(len(right)), (2, 7, 12))[:, None] * (0.0, 1.0, 0.0)
    paths = trajectory(times_s, left), trajectory(times_s, far)
    found = find_steps(body(times_s, left, right), *paths)
    assert [one.foot for one in found] == [one.foot for one in expected]


def test_first_landing_that_is_late_hardly_changes_the_cadence() -> None:
    times_s = np.arange(0, 6, 1 / 30)
    steps = found_steps(*feet(times_s), times_s)
    late = [replace(steps[0], landed_s=steps[0].landed_s + 0.15), *steps[1:]]
    expected, found = cadence(steps), cadence(late)
    assert expected is not None
    # The mean of the ten times between landings changes by 0.15 s / (10 x 0.5 s) = 3 %. Of the 55
    # pairs of landings 10 include the late landing, and the median of all times hardly changes.
    assert found == pytest.approx(expected, rel=0.005)
