"""Yaw by its density on the circle: terms by hand, turns and wrong measurements."""

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from common.geometry.transforms import wrap
from people4d.messages import F64
from services.tracker.interface import Measurement
from services.tracker.motion.yaw_density import (
    ANGLES,
    BINS,
    CORRELATION_S,
    DENSITY,
    NEAR,
    RATE,
    RATE_DECAY_S,
    SHARE,
    SINCE,
    STEP_RAD,
    TURN_RADPS,
    UNKNOWN,
    DensityYaw,
    YawMeasurements,
    likelihood_measured,
)
from tests.tracker.scene import AT_REST, facing

FILTER = DensityYaw()


def predict(before: F64, dt_s: float, filter_: DensityYaw = FILTER) -> F64:
    (after,) = filter_.predict([before], dt_s)
    assert after is not None
    return after


def update(before: F64 | None, detected: Measurement) -> F64:
    (after,) = FILTER.update([before], [detected])
    assert after is not None
    return after


def shown(yaw_rad: float | None, sigma_rad: float = 0.15) -> Measurement:
    """A person straight before a camera that looks along +x: 0 shows the back, pi the front."""
    return replace(facing(yaw_rad, sigma_rad), bearing_rad=0.0)


def filtered(angles: Iterable[float | None]) -> list[float | None]:
    """The published yaws of frames, ten a second."""
    state, published = None, list[float | None]()
    for angle in angles:
        before = None if state is None else predict(state, 0.1)
        state = update(before, shown(angle))
        published.append(FILTER.read(state, AT_REST))
    return published


def errors_deg(published: Iterable[float | None], yaw_rad: float) -> list[float]:
    assert None not in published
    return [math.degrees(abs(wrap(yaw - yaw_rad))) for yaw in published if yaw is not None]


# Parts by hand


def likelihood(yaw_rad: float, sigma_rad: float, factor: float = 1.0) -> F64:
    """Of a measured yaw of a person straight before a camera that looks along +x."""
    yaws = YawMeasurements(np.array([yaw_rad]), np.array([sigma_rad]), np.zeros(1))
    (likelihoods,) = likelihood_measured(yaws, np.array([factor]))
    return np.asarray(likelihoods, np.float64)


def test_likelihood_of_a_measurement_by_hand() -> None:
    # 0 measured with 0.5 rad: reversed in 0.005 of all cases, any angle in 0.003.
    p = likelihood(0.0, 0.5)
    peak, flat = 1 / (math.sqrt(2 * math.pi) * 0.5), 0.003 / (2 * math.pi)
    assert p[0] == pytest.approx(0.997 * 0.995 * peak + flat)
    assert p[BINS // 2] == pytest.approx(0.997 * 0.005 * peak + flat)
    far = peak * math.exp(-((math.pi / 2 / 0.5) ** 2) / 2)  # 90 deg: both are 3.14 sigma off
    assert p[BINS // 4] == pytest.approx(0.997 * far + flat)


def test_large_sigma_is_a_chance_of_any_other_angle() -> None:
    # 1 rad: 0.5 rad, and (1 - 0.25) / pi^2 more of other angles.
    other = 0.003 + 0.75 / math.pi**2
    peak = 1 / (math.sqrt(2 * math.pi) * 0.5)
    expected = (1 - other) * 0.995 * peak + other / (2 * math.pi)
    assert likelihood(0.0, 1.0)[0] == pytest.approx(expected)
    np.testing.assert_allclose(likelihood(0.0, 100.0), 1 / (2 * math.pi), rtol=0.4)


def test_nothing_is_learnt_from_unmeasured_yaws() -> None:
    known = predict(update(None, shown(1.0)), 0.1)
    after = update(known, shown(None))
    np.testing.assert_allclose(after[DENSITY], known[DENSITY], rtol=1e-3)
    assert after[SINCE] == 0.0
    never = update(None, facing(None))
    np.testing.assert_allclose(never[DENSITY], 1 / BINS, rtol=1e-5)
    assert FILTER.read(never, AT_REST) is None
    assert FILTER.read(None, AT_REST) is None


def test_turns_have_a_wrapped_cauchy_density() -> None:
    certain = UNKNOWN.copy()
    certain[DENSITY] = 1e-9
    certain[DENSITY.start] = 1.0
    after = predict(certain, 0.5)[DENSITY]
    scale = 0.5 * TURN_RADPS
    expected = math.sinh(scale) / (math.cosh(scale) - np.cos(ANGLES)) * STEP_RAD / (2 * math.pi)
    np.testing.assert_allclose(after, expected, rtol=1e-6)


def test_turn_rate_decays() -> None:
    # After tau ln 2 half the rate is left; turned by tau (1 - 1/2) of it.
    tau = RATE_DECAY_S
    turning = update(None, shown(0.0))
    turning[RATE] = 1.0
    after = predict(turning, tau * math.log(2))
    assert after[RATE] == pytest.approx(0.5)
    assert after[0] == pytest.approx(tau / 2, abs=0.01)


def test_long_prediction_is_that_of_short_steps() -> None:
    steps = joint = update(None, shown(1.0))
    for _ in range(7):
        steps = predict(steps, 0.1)
    joint = predict(joint, 0.7)
    np.testing.assert_allclose(joint, steps, atol=1e-6)


def test_frames_that_follow_sooner_count_less_but_for_the_angle() -> None:
    # Errors are correlated for 0.2 s. After a third of that time the likelihood of another angle is
    # the cube root of the full likelihood. The peak is as sharp: sigma / root 3, to the power 1/3.
    state = update(None, shown(0.0))
    state[DENSITY] = 1 / BINS
    state[SINCE] = CORRELATION_S / 3
    soon = update(state, shown(0.3))[DENSITY]
    expected = likelihood(0.3, 0.15, math.sqrt(1 / 3)) ** (1 / 3)
    np.testing.assert_allclose(soon / soon.max(), expected / expected.max(), rtol=1e-6)
    state[SINCE] = 10.0
    later = update(state, shown(0.3))[DENSITY]
    opposite, at = BINS // 2 + 2, 2
    assert soon[opposite] / soon[at] > 5 * later[opposite] / later[at]


def test_another_camera_counts_in_the_same_instant() -> None:
    state = update(None, shown(0.0))
    again = update(state, shown(math.pi))
    other = update(state, replace(shown(math.pi), bearing_rad=math.pi / 2))
    np.testing.assert_allclose(again[DENSITY], state[DENSITY], atol=1e-9)
    assert other[DENSITY][BINS // 2] > 10 * state[DENSITY][BINS // 2]
    assert abs(other[RATE]) < 2.0


@pytest.mark.parametrize("turn_deg", [10, 90, 179, -135])
def test_turning_the_world_turns_the_yaw(turn_deg: float) -> None:
    angles = np.random.default_rng(3).normal(3.0, 0.15, 40).tolist()
    turn = math.radians(turn_deg)
    one = filtered(angles)
    state, other = None, list[float | None]()
    for z in angles:
        turned = replace(shown(wrap(z + turn)), bearing_rad=wrap(turn))
        state = update(None if state is None else predict(state, 0.1), turned)
        other.append(FILTER.read(state, AT_REST))
    for a, b in zip(one, other, strict=True):
        assert a is not None
        assert b is not None
        assert wrap(b - a - turn) == pytest.approx(0.0, abs=math.radians(1.5))


def test_people_in_a_stack_do_not_mix() -> None:
    known = [predict(update(None, shown(yaw)), 0.1) for yaw in (0.1, 3.0)]
    crowd = [known[0], None, known[1], None]
    detected = [shown(0.5), facing(None), facing(None), shown(-1.0)]
    after = FILTER.update(crowd, detected)
    for k in range(4):
        alone, together = update(crowd[k], detected[k]), after[k]
        assert together is not None
        np.testing.assert_allclose(together, alone, atol=1e-9)
        later = FILTER.predict(after, 0.1)[k]
        assert later is not None
        np.testing.assert_allclose(later, predict(together, 0.1), atol=1e-9)


# People


def test_first_measurement_is_published() -> None:
    assert FILTER.read(update(None, shown(2.0)), AT_REST) == pytest.approx(2.0, abs=1e-3)


def test_person_who_turns_round_is_followed_within_30_deg() -> None:
    # A person on filinha, ten frames a second: 28, 60, no angle, 140, 172 deg.
    angles = [23, 25, 28, 60, None, 140, 172, 172]
    published = filtered(None if a is None else math.radians(a) for a in angles)
    for angle, yaw in zip(angles, published, strict=True):
        if angle is not None:
            assert errors_deg([yaw], math.radians(angle))[0] < 30


@pytest.mark.parametrize("yaw_rad", [0.0, math.pi])
def test_yaw_is_not_reversed_by_a_single_frame(yaw_rad: float) -> None:
    reversed_ = wrap(yaw_rad + math.pi)
    published = filtered([yaw_rad] * 20 + [reversed_] + [yaw_rad] * 10)
    assert max(errors_deg(published, yaw_rad)) < 10


@pytest.mark.parametrize("yaw_rad", [0.0, math.pi])
def test_opposite_yaw_is_followed_after_two_frames(yaw_rad: float) -> None:
    published = filtered([wrap(yaw_rad + math.pi)] * 10 + [yaw_rad] * 2)
    assert errors_deg(published[-1:], yaw_rad)[0] < 10


def test_reversed_first_measurement_is_corrected_by_the_second() -> None:
    published = filtered([math.pi, 0.0, 0.0])
    assert errors_deg(published[-1:], 0.0)[0] < 10


def test_unmeasured_yaw_is_unknown_after_a_second() -> None:
    state = update(None, shown(1.0))
    assert FILTER.read(predict(state, 0.2), AT_REST) == pytest.approx(1.0, abs=0.03)
    assert FILTER.read(predict(state, 1.0), AT_REST) is None
    gone = predict(state, 1e9)
    assert gone[SHARE] == pytest.approx(len(NEAR) / BINS)
    # The next measurement is accepted at once.
    assert FILTER.read(update(gone, shown(-2.0)), AT_REST) == pytest.approx(-2.0, abs=1e-2)


def test_uncertain_measurement_counts_less() -> None:
    state = predict(update(None, shown(0.0)), 0.1)
    certain, uncertain = (update(state, shown(0.5, sigma)) for sigma in (0.1, 0.6))
    assert certain[0] > 2 * uncertain[0] > 0.0


def test_measurement_that_is_no_number_is_refused() -> None:
    state = predict(update(None, shown(0.3)), 0.1)
    for yaw_rad in (math.nan, math.inf):
        np.testing.assert_allclose(update(state, shown(yaw_rad)), update(state, shown(None)))
