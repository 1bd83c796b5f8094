"""True steps: the cadence of steady walking."""

import numpy as np
import pytest

from benchmarks.lib.gait.truth import even_truth, steady_cadence
from lab.truth.motion_capture import Footfall


def test_steps_of_turns_count_for_the_mean_cadence_only() -> None:
    times_s = np.cumsum([0.0, *[0.5] * 5, 0.9, 0.9, *[0.5] * 5])
    falls = [Footfall(float(t), k % 2, np.array([0.6 * k, 0.0])) for k, t in enumerate(times_s)]
    assert steady_cadence(falls) == pytest.approx(120)
    walked = even_truth(falls)
    assert walked is not None
    assert walked[1] < 118


def test_a_single_step_has_no_cadence() -> None:
    assert steady_cadence([Footfall(1.0, 0, np.zeros(2))]) is None
