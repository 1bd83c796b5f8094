"""The normative table and how it depends on speed."""

import numpy as np
import pytest

from lab.motion.gait import gait_curve, step_length_m, swing_share

PHASES = np.linspace(0.0, 1.0, 201)
EVEN = ["pelvis.up_m", "pelvis.ahead_m", "pelvis.tilt_deg", "chest.pitch_deg"]
ODD = ["pelvis.left_m", "pelvis.list_deg", "pelvis.turn_deg", "chest.turn_deg", "chest.list_deg"]
ALL = [*EVEN, *ODD, "foot.pitch_deg", "arm.shoulder_deg", "arm.elbow_deg"]


@pytest.mark.parametrize("name", ALL)
def test_a_curve_repeats_and_has_no_corner_where_it_does(name: str) -> None:
    np.testing.assert_allclose(gait_curve(name, PHASES), gait_curve(name, PHASES + 3.0), atol=1e-9)
    # The slope changes by less than a twentieth of the curve's size for each cycle.
    before, at, after = gait_curve(name, [1.0 - 1e-5, 1.0, 1.0 + 1e-5])
    size = np.ptp(gait_curve(name, PHASES))
    assert abs((after - at) - (at - before)) / 1e-5 < 0.05 * size


@pytest.mark.parametrize("name", EVEN)
def test_symmetric_curves_repeat_with_each_step(name: str) -> None:
    np.testing.assert_allclose(gait_curve(name, PHASES), gait_curve(name, PHASES + 0.5), atol=1e-9)


@pytest.mark.parametrize("name", ODD)
def test_left_and_right_mirror_each_other(name: str) -> None:
    np.testing.assert_allclose(gait_curve(name, PHASES), -gait_curve(name, PHASES + 0.5), atol=1e-9)


def test_the_pelvis_moves_as_published() -> None:
    # Murray 1964: 4 to 5 cm up and down, 4 to 5 cm from side to side.
    assert np.ptp(gait_curve("pelvis.up_m", PHASES)) == pytest.approx(0.04, abs=0.005)
    assert np.ptp(gait_curve("pelvis.left_m", PHASES)) == pytest.approx(0.044, abs=0.006)
    # Lowest while both feet stand (just after heel contact), over the left foot in its stance.
    assert PHASES[np.argmin(gait_curve("pelvis.up_m", PHASES[:100]))] == pytest.approx(
        0.05, abs=0.02
    )
    assert 0.2 < PHASES[np.argmax(gait_curve("pelvis.left_m", PHASES))] < 0.4


def test_step_length_is_the_walk_ratio_times_cadence() -> None:
    # sqrt(0.0064 x 60 x 0.9375) = sqrt(0.36) = 0.6 m; cadence 0.9375 x 60 / 0.6 = 93.75 a minute;
    # 0.6 / 93.75 = 0.0064.
    assert step_length_m(0.9375, 1.70) == pytest.approx(0.6)
    # A person 16 times as tall takes steps 16^0.75 = 8 times as long.
    assert step_length_m(0.9375, 16 * 1.70) == pytest.approx(8 * 0.6)


def test_slow_walkers_keep_their_feet_longer_on_the_floor() -> None:
    assert swing_share(0.5) < swing_share(0.9) < swing_share(1.3)
    assert swing_share(1.3) == pytest.approx(0.39, abs=0.01)
