"""Motion from points: known motions, outliers on people, and the covariance."""

import numpy as np
import pytest

from common.geometry.transforms import apply, invert, rotation_from_rpy, transform_from
from people4d.messages import F64
from services.visual_odometry import fit as fitting
from services.visual_odometry.fit import SIGMA_FACTOR, MotionFit, MotionPrior, fit_motion
from services.visual_odometry.odometer import SIGMA_PX
from services.visual_odometry.reprojection import BaseMount, Matches
from tests.visual_odometry.room import BASE_FROM_OPTICAL, base

FOCAL_PX = 600.0
PLANAR = BaseMount(BASE_FROM_OPTICAL, planar=True)
ANY = BaseMount(BASE_FROM_OPTICAL, planar=False)


def points(count: int, seed: int = 0) -> F64:
    rng = np.random.default_rng(seed)
    rays = rng.uniform([-0.5, -0.4], [0.5, 0.4], (count, 2))
    z = rng.uniform(1.5, 5.0, (count, 1))
    return np.concatenate([rays * z, z], axis=1)


def rays_after(points_m: F64, motion: F64) -> F64:
    """Return the rays to known points after a motion of the base."""
    now = apply(invert(BASE_FROM_OPTICAL) @ invert(motion) @ BASE_FROM_OPTICAL, points_m)
    return np.asarray(now[:, :2] / now[:, 2:])


def prior(mount: BaseMount, sigma: float = 10.0) -> MotionPrior:
    """Return a prior with little information."""
    return MotionPrior(np.eye(4), sigma**2 * np.eye(len(mount.free)))


def fitted(
    points_m: F64, rays: F64, mount: BaseMount = PLANAR, known: dict[str, F64] | None = None
) -> MotionFit | None:
    depths, known = points_m[:, 2], known or {}
    matches = Matches(
        points_m[:, :2] / depths[:, None],
        rays,
        known.get("inverse", 1 / depths),
        known.get("sigmas", np.full(len(depths), 1e-4)),
        np.full(len(depths), SIGMA_PX / FOCAL_PX),
        np.zeros(len(depths), np.bool_),
    )
    return fit_motion(matches, mount, prior(mount))


@pytest.mark.parametrize(
    "motion", [base(0.2, 0.05, 0.15), base(-0.1, 0.0, -0.2), base(0.0, 0.0, 0.0)]
)
def test_motion_on_the_floor_is_exact_without_noise(motion: F64) -> None:
    known = points(80)
    fit = fitted(known, rays_after(known, motion))
    assert fit is not None
    assert fit.before_from_now == pytest.approx(motion, abs=1e-6)
    assert fit.inliers.all()
    assert fit.covariance.shape == (3, 3)  # on a floor x, y and yaw only


def test_motion_of_a_carried_camera_has_six_degrees_of_freedom() -> None:
    known = points(80)
    motion = transform_from((0.1, -0.05, 0.08), rotation_from_rpy(0.1, -0.05, 0.1))
    fit = fitted(known, rays_after(known, motion), ANY)
    assert fit is not None
    assert fit.before_from_now == pytest.approx(motion, abs=1e-6)
    assert (np.diag(fit.covariance) > 0).all()


def test_a_third_of_the_points_on_a_walking_person_are_outliers() -> None:
    """A person steps 10 cm aside with 40 of 120 points; the 80 points of the room decide."""
    known, motion = points(120), base(0.05, 0.0, 0.1)
    walked = known.copy()
    walked[:40, 0] += 0.1
    fit = fitted(known, rays_after(walked, motion))
    assert fit is not None
    assert fit.before_from_now == pytest.approx(motion, abs=2e-3)
    assert fit.inliers[40:].all()
    assert fit.inliers[:40].mean() < 0.2


def test_points_beyond_the_range_give_rotation_without_translation() -> None:
    """40 points between 6 and 20 m have an inverse depth of 0.1 +- 0.06 1/m."""
    known = points(40)
    known *= np.random.default_rng(4).uniform(6, 20, (40, 1)) / known[:, 2:]
    far = {"inverse": np.full(40, 0.1), "sigmas": np.full(40, 0.06)}
    motion = base(0.1, 0.0, 0.1)
    fit = fitted(known, rays_after(known, motion), known=far)
    assert fit is not None
    turned = np.arctan2(fit.before_from_now[1, 0], fit.before_from_now[0, 0])
    assert turned == pytest.approx(0.1, abs=2e-3)
    sigmas = np.sqrt(np.diag(fit.covariance))
    near = fitted(points(40), rays_after(points(40), motion))
    assert near is not None
    assert sigmas[0] > 5 * np.sqrt(near.covariance[0, 0])


def test_a_known_motion_gives_depth() -> None:
    """0.2 m ahead with half of the depths known: errors of the others are a few percent."""
    known, motion = points(60), base(0.2, 0.05, 0.05)
    inverse = 1 / known[:, 2]
    thought, sigmas = inverse.copy(), np.full(60, 1e-4)
    thought[30:], sigmas[30:] = 0.4, 0.2
    fit = fitted(known, rays_after(known, motion), known={"inverse": thought, "sigmas": sigmas})
    assert fit is not None
    estimated = thought + fit.depth_errors
    certain = fit.inliers & (fit.depth_sigmas < 0.1)
    assert certain[30:].sum() > 10
    off = np.abs(estimated - inverse)[certain]
    assert off.max() < 0.03


def test_errors_agree_with_the_covariance() -> None:
    """Mean chi-squared of 100 motions with noise of 0.7 px is about 1, without the inflation."""
    rng, motion = np.random.default_rng(1), base(0.1, 0.0, 0.1)
    values = []
    for seed in range(100):
        known = points(60, seed)
        rays = rays_after(known, motion) + rng.normal(0, 0.7 / FOCAL_PX, (60, 2))
        fit = fitted(known, rays)
        assert fit is not None
        off = invert(motion) @ fit.before_from_now
        error = np.array([off[0, 3], off[1, 3], np.arctan2(off[1, 0], off[0, 0])])
        values.append(error @ np.linalg.inv(fit.covariance / SIGMA_FACTOR**2) @ error / 3)
    assert 0.6 < np.mean(values) < 1.4


def test_more_noise_increases_the_covariance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three times the assumed noise gives about nine times the variance, if all are inliers."""
    monkeypatch.setattr(fitting, "GATE_SIGMAS", 12.0)
    rng, known, variances = np.random.default_rng(2), points(60), []
    for noise_px in (0.7, 2.1):
        rays = rays_after(known, base()) + rng.normal(0, noise_px / FOCAL_PX, (60, 2))
        fit = fitted(known, rays)
        assert fit is not None
        variances.append(fit.covariance[2, 2])
    assert 5 < variances[1] / variances[0] < 25


def test_motion_far_from_its_prior_is_rejected() -> None:
    """5 cm is 50 standard deviations from a prior of 1 mm, and half of one from 0.1 m."""
    known = points(14)
    matches = Matches(
        known[:, :2] / known[:, 2:],
        rays_after(known, base(0.05)),
        1 / known[:, 2],
        np.full(14, 1e-4),
        np.full(14, SIGMA_PX / FOCAL_PX),
        np.zeros(14, np.bool_),
    )
    certain = MotionPrior(np.eye(4), np.diag([1e-3, 1e-3, 1e-3]) ** 2)
    assert fit_motion(matches, PLANAR, certain) is None  # 50 standard deviations off
    wide = MotionPrior(np.eye(4), np.diag([0.1, 0.1, 0.1]) ** 2)
    fit = fit_motion(matches, PLANAR, wide)
    assert fit is not None
    assert fit.before_from_now[0, 3] == pytest.approx(0.05, abs=1e-3)


def test_undetermined_motion_gives_none() -> None:
    known = points(30)
    assert fitted(known[:11], rays_after(known[:11], base())) is None  # 12 are required
    chaos = np.random.default_rng(3).uniform(-0.4, 0.4, (30, 2))
    assert fitted(known, chaos) is None
    same = np.repeat(known[:1], 30, axis=0)  # one point, thirty times: rotation about it is unknown
    fit = fitted(same, rays_after(same, base()), ANY)
    assert fit is not None
    assert np.sqrt(np.diag(fit.covariance)).max() > 5
