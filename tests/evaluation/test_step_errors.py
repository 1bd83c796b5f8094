"""Errors of steps: none for true trajectories, the true one for wrong ones."""

import numpy as np
import pytest

from evaluation.gait.step_errors import compare_steps
from lab.truth.motion_capture import Footfall
from tests.gait.steps.test_steps import feet

TIMES_S = np.arange(0, 8, 1 / 30)


def walked() -> np.ndarray:
    return np.stack(feet(TIMES_S), axis=1)


def falls(step_s: float = 0.5, step_m: float = 0.6) -> list[Footfall]:
    """Return the steps of `feet`: right ones at 0.5, 1.5, ... s, left ones at 1, 2, ... s."""
    numbers = range(1, round(8 / step_s))
    return [
        Footfall(n * step_s, n % 2, np.array([n * step_m, 0.2 * (n % 2 == 0)])) for n in numbers
    ]


@pytest.mark.slow
def test_true_trajectories_have_no_errors() -> None:
    errors = compare_steps(TIMES_S, walked(), falls())
    # Feet come down 15 times.
    assert (errors.found, errors.true, errors.extra) == (15, 15, 0)
    assert errors.length_m == pytest.approx(np.zeros(len(errors.length_m)), abs=0.005)
    # Strides end at 1.5, 2.0, 2.5, ... s, and three of them are needed: published after 2.5 s, and
    # compared at 0.5, 1.0, ... 7.5 s.
    assert errors.compared == 15
    assert len(errors.means) >= 10
    assert np.nanmax(np.abs(errors.means)) < 0.01  # at first there is no asymmetry


@pytest.mark.slow
def test_wrong_cadence_is_reported() -> None:
    # The same feet, while the true steps were of 0.55 s and 0.5 m: in a stride of 1 s there is time
    # for 1 / 0.55 steps. Cadence is too high by a tenth, length by 0.1 m.
    errors = compare_steps(TIMES_S, walked(), falls(step_s=0.55, step_m=0.5))
    length_m, cadence, *_ = np.median(errors.means, axis=0)
    assert length_m == pytest.approx(0.1, abs=0.01)
    assert cadence == pytest.approx(0.1, abs=0.02)


def test_no_steps_give_no_errors() -> None:
    errors = compare_steps(TIMES_S, np.full_like(walked(), np.nan), falls())
    assert (errors.found, errors.true, errors.extra, len(errors.means)) == (0, 15, 0, 0)
