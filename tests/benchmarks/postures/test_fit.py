"""Fit of the states of postures."""

import numpy as np

from benchmarks.lib.postures.fit import BODIES, WIDER, fit
from people4d.messages.skeleton import POSTURES
from services.skeleton.posture import MEANS, STATES

BENT = [k for k, posture in enumerate(STATES) if POSTURES[posture] == "sitting"][1]


def test_frames_move_the_nearest_state_of_their_posture_only() -> None:
    rng = np.random.default_rng(1)
    shift = np.array([0.05, -0.05, 0.0, 0.03, 0.02, 0.0, 0.04])
    rows = MEANS[BENT] + shift + rng.normal(0, 0.02, (400, 7))
    rows[::2, 1] = np.nan  # half of the thighs are hidden
    means, sigmas = fit([(STATES[BENT], row) for row in rows])
    assert np.abs(means[BENT] - MEANS[BENT] - shift).max() < 0.01
    others = np.arange(len(STATES)) != BENT
    assert (means[others] == MEANS[others]).all()
    assert np.abs(sigmas - WIDER * np.hypot(0.02, BODIES)).max() < 0.01
