"""Posture of people from observed joints."""

import numpy as np
import pytest

from people4d.messages import F64
from people4d.messages.skeleton import Posture
from services.skeleton.body import USUAL_POSE_M
from services.skeleton.observation import JointObservation
from services.skeleton.posture import PostureFilter
from services.skeleton.skeletons import People

PERIOD_S = 0.1
LEGS, HIPS, KNEES, ANKLES = [13, 14, 15, 16], [11, 12], [13, 14], [15, 16]


def standing() -> F64:
    return np.asarray(USUAL_POSE_M + np.array([3.0, 0.0, 1.05]))


def sitting() -> F64:
    pose = standing()
    pose[KNEES] = pose[HIPS] + (0.4, 0.0, 0.0)
    pose[ANKLES] = pose[KNEES] - (0.0, 0.0, 0.4)
    return pose


def lying() -> F64:
    return np.asarray(USUAL_POSE_M[:, [2, 1, 0]] + np.array([3.0, 0.0, 0.2]))


def bending() -> F64:
    pose = standing()
    torso = pose[:11] - pose[HIPS].mean(axis=0)
    pose[:11] = pose[HIPS].mean(axis=0) + torso[:, [2, 1, 0]] * (1.0, 1.0, -1.0)
    return pose


def tilted(pose: F64, angle_rad: float) -> F64:
    """Return a pose as a camera with an unknown pitch places it."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.asarray(pose @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).T)


def people(pose_m: F64, speed_mps: float = 0.0) -> People:
    middle = pose_m[[5, 6, 11, 12]].mean(axis=0)
    return People(
        ids=[1],
        position_m=middle[None],
        velocity_mps=np.array([[speed_mps, 0.0, 0.0]]),
        covariance_m2=np.zeros((1, 3, 3)),
        yaw_rad=np.array([np.nan]),
    )


def observed(pose_m: F64, hidden: list[int]) -> JointObservation:
    range_m = np.linalg.norm(pose_m, axis=1)
    rays = pose_m / range_m[:, None]
    range_m[hidden] = np.nan
    return JointObservation(
        np.zeros(3), np.full((1, 17), 0.9), rays[None], range_m[None], np.full((1, 17), 0.05), 0.003
    )


def posture(
    pose_m: F64, *, count: int = 10, speed_mps: float = 0.0, hidden: list[int] | None = None
) -> tuple[Posture, float]:
    """Return the posture after a number of frames."""
    postures = PostureFilter()
    for _ in range(count):
        (found,), _upright = postures.update(
            PERIOD_S, people(pose_m, speed_mps), observed(pose_m, hidden or [])
        )
    return found


@pytest.mark.parametrize("pose_of", [standing, sitting, lying, bending])
def test_posture_is_named_within_a_second(pose_of) -> None:  # type: ignore[no-untyped-def]
    name, probability = posture(pose_of())
    assert name == pose_of.__name__
    assert 0.6 <= probability <= 1.0


@pytest.mark.parametrize("speed_mps", [0.6, 0.9, 2.5])
def test_person_who_moves_upright_walks(speed_mps: float) -> None:
    assert posture(standing(), speed_mps=speed_mps)[0] == "walking"


@pytest.mark.parametrize("speed_mps", [0.4, 0.8, 2.5])
def test_seated_person_who_rolls_sits(speed_mps: float) -> None:
    assert posture(sitting(), speed_mps=speed_mps)[0] == "sitting"


def test_moving_person_with_hidden_legs_walks() -> None:
    assert posture(standing(), speed_mps=0.8, hidden=LEGS)[0] == "walking"


def test_standing_person_walks_within_half_a_second() -> None:
    postures = PostureFilter()
    for speed_mps in [0.0] * 20 + [0.8] * 5:
        (found,), _ = postures.update(
            PERIOD_S, people(standing(), speed_mps), observed(standing(), [])
        )
    assert found[0] == "walking"


@pytest.mark.parametrize("pose_of", [standing, lying])
def test_person_without_readings_has_no_posture(pose_of) -> None:  # type: ignore[no-untyped-def]
    assert posture(pose_of(), hidden=list(range(17))) == ("unknown", 0.0)


def test_bent_person_with_hidden_legs_is_not_lying() -> None:
    assert posture(bending(), hidden=LEGS)[0] != "lying"


@pytest.mark.parametrize("degrees", [25, 40])
def test_upright_person_before_a_tilted_camera_is_not_lying(degrees: float) -> None:
    for sign in (-1, 1):
        assert posture(tilted(standing(), np.radians(sign * degrees)))[0] != "lying"


@pytest.mark.parametrize("pose_of", [standing, lying])
def test_posture_without_hips_follows_from_shoulders_knees_and_ankles(pose_of) -> None:  # type: ignore[no-untyped-def]
    assert posture(pose_of(), hidden=HIPS)[0] == pose_of.__name__


def test_squatting_person_with_hidden_knees_is_not_sitting() -> None:
    """After standing, the torso is 0.45 m lower: hips above the feet bend, hips behind them sit."""
    postures, low = PostureFilter(), standing()
    low[:13, 2] -= 0.45
    for pose, hidden in [(standing(), [])] * 30 + [(low, KNEES)] * 10:
        (found,), _ = postures.update(PERIOD_S, people(pose), observed(pose, list(hidden)))
    assert found[0] == "bending"


def test_reading_of_another_surface_far_from_the_track_is_ignored() -> None:
    pose = standing()
    far = pose.copy()
    far[LEGS] += (2.5, 0.0, 0.0)
    postures = PostureFilter()
    for _ in range(10):
        (found,), _ = postures.update(PERIOD_S, people(pose), observed(far, []))
    assert found[0] in ("standing", "unknown")


def test_restart_forgets_the_posture() -> None:
    postures = PostureFilter()
    for _ in range(10):
        postures.update(PERIOD_S, people(lying()), observed(lying(), []))
    postures.restart()
    (found,), _ = postures.update(0.0, people(lying()), observed(lying(), []))
    assert found == ("unknown", 0.0)
    assert postures.update(0.1, People.from_tracks([]), observed(lying(), []))[0] == []
