"""Interacting models of standing and walking people, by hand and over time."""

import numpy as np
import pytest

from common.imm import mix
from people4d.messages import F64
from services.tracker.motion.motion import PositionMotion
from services.tracker.motion.state_filter import STANDING, WALKING, Imm
from services.tracker.motion.track_record import ImmState
from services.tracker.strongsort3d.build import build_strongsort3d
from tests.tracker.scene import frame, person, published, published_config

UNMATCHED = np.array([False])
CONFIG = published(
    sigma_acceleration_mps2=3.0,
    sigma_measurement_m=0.354,  # 0.15 m for a score of 0.9 at 4 m
    standing_model=True,
)


def imm() -> Imm:
    return Imm(PositionMotion(CONFIG))


def stacked(modes: ImmState) -> tuple[F64, F64, F64]:
    return modes.x[None], modes.P[None], modes.mode_probability[None]


def state(x_m: float, vx_mps: float) -> F64:
    return np.array([x_m, 0.0, 0.0, vx_mps, 0.0, 0.0])


def test_mixing_of_modes_by_hand() -> None:
    # Probabilities 0.5 and 0.5. Standing people start to walk with 0.2, walking people stop with
    # 0.4. P(standing) = 0.5 * 0.8 + 0.5 * 0.4 = 0.6; a share of 0.4 / 0.6 = 2/3 stood before.
    # P(walking) = 0.4; a share of 0.1 / 0.4 = 1/4 stood before.
    # Positions 0 (stood) and 3 (walked): 2/3 * 0 + 1/3 * 3 = 1 and
    # 1/4 * 0 + 3/4 * 3 = 2.25. Variances 1 and 1, and between the places
    # 2/3 * 1 + 1/3 * 4 = 2 and 1/4 * 5.0625 + 3/4 * 0.5625 = 1.6875.
    x = np.array([[state(0.0, 0.0), state(3.0, 0.0)]])
    P = np.array([[np.eye(6), np.eye(6)]])
    change = np.array([[0.8, 0.2], [0.4, 0.6]])
    mean, covariance, share = mix(x, P, np.array([[0.5, 0.5]]), change)
    np.testing.assert_allclose(share, [[0.6, 0.4]])
    np.testing.assert_allclose(mean[0, :, 0], [1.0, 2.25])
    np.testing.assert_allclose(covariance[0, :, 0, 0], [3.0, 2.6875])
    np.testing.assert_allclose(covariance[0, :, 1, 1], [1.0, 1.0])


def test_mean_of_both_modes() -> None:
    # 0.75 stand at 0, 0.25 walk at 1 m with 2 m/s: position 0.25 m, velocity 0.5 m/s. Variance of
    # the position: 0.1 within, and 0.75 * 0.0625 + 0.25 * 0.5625 = 0.1875 between; of the velocity
    # 0.75 * 0.03^2 + 0.25 * 0.1 = 0.025675 within and 0.75 * 0.25 + 0.25 * 2.25 = 0.75 between.
    both = ImmState(
        np.array([state(0.0, 0.0), state(1.0, 2.0)]),
        np.array([0.1 * np.eye(6)] * 2),
        np.array([0.75, 0.25]),
    )
    (found,) = imm().means(*stacked(both))
    x, P = found.x, found.P
    np.testing.assert_allclose(x[[0, 3]], [0.25, 0.5])
    assert P[0, 0] == pytest.approx(0.2875)
    assert P[3, 3] == pytest.approx(0.025675 + 0.75)


def test_zero_time_step_changes_nothing() -> None:
    models = imm()
    start = models.start(state(1.0, 0.5), 0.1 * np.eye(6))
    x, _, probability = models.predict_modes(*stacked(start), UNMATCHED, 0.0)
    np.testing.assert_allclose(probability[0], start.mode_probability)
    np.testing.assert_allclose(x[0, WALKING], start.x[WALKING])
    assert x[0, STANDING, 3] == 0.0


def run(xs: list[float]) -> list[float]:
    """Speeds of a person measured at distances, ten a second."""
    tracker = build_strongsort3d(published_config(strongsort3d=CONFIG))
    speeds = []
    for number, x in enumerate(xs):
        (track,) = tracker.update(frame(number, person(x, 0.0)))
        speeds.append(float(track.velocity_mps[0]))
    return speeds


def test_velocities_of_standing_and_walking_people() -> None:
    # Errors of 0.05 m for 5 s, then 1 m/s for 2 s, then a stop.
    errors = np.random.default_rng(3).normal(0, 0.05, 120)
    true = np.concatenate([np.full(50, 4.0), 4.0 + np.arange(1, 21) / 10, np.full(50, 6.0)])
    speeds = np.abs(run((true + errors).tolist()))
    assert np.percentile(speeds[15:50], 95) < 0.05
    assert speeds[62:70] == pytest.approx(1.0, abs=0.35)
    assert np.percentile(speeds[100:], 95) < 0.06


def test_walking_mode_is_probable_within_half_a_second() -> None:
    speeds = run([4.0] * 30 + [4.0 + 0.1 * k for k in range(1, 11)])
    assert speeds[30 + 5] > 0.5


def test_covariances_stay_positive_definite() -> None:
    models = imm()
    start = models.start(state(4.0, 0.0), 0.1 * np.eye(6))
    modes, rng = stacked(start), np.random.default_rng(1)
    for _ in range(300):
        modes = models.predict_modes(*modes, UNMATCHED, float(rng.uniform(0.0, 0.3)))
        modes = models.update_modes(*modes, rng.normal(4, 0.1, (1, 3)), 0.02 * np.eye(3)[None])
        (mean,) = models.means(*modes)
        assert np.linalg.eigvalsh(mean.P).min() > 0
