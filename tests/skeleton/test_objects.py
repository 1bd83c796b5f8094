"""Objects among tracked figures: posters, and figures that never move."""

from collections.abc import Callable

import numpy as np
import pytest

from people4d.messages import F64
from people4d.messages.skeleton import Posture
from services.skeleton.body import INSIDE_M
from services.skeleton.objects import ObjectFilter
from tests.skeleton.test_posture import PERIOD_S, observed, people, standing

FRAMES = 1300  # 130 s: e^(130 / 20) times the prior odds of 1 to 19


def still(number: int) -> F64:
    return standing()


def swaying(number: int) -> F64:
    """Return a person whose head goes 12 mm to and fro every 10 s, as in quiet standing."""
    side_m = 0.006 * np.sin(2 * np.pi * number * PERIOD_S / 10.0)
    return np.asarray(standing() + np.array([0.0, side_m, 0.0]))


def poster(number: int) -> F64:
    """Return a walking person whose surface is a plane at 3 m."""
    pose = standing()
    pose[[9, 10], 1] += 0.2 * np.sin(number * PERIOD_S)
    rays = pose / np.linalg.norm(pose, axis=1, keepdims=True)
    return np.asarray(rays * (3.0 / rays[:, :1] + INSIDE_M[:, None]))


def object_like(
    pose_of: Callable[[int], F64],
    frames: int = FRAMES,
    posture: Posture = "standing",
    noise_m: float = 0.0,
    hidden: list[int] | None = None,
) -> float:
    """Return the probability of an object after a number of frames."""
    objects, rng, found = ObjectFilter(), np.random.default_rng(1), 0.0
    for number in range(frames):
        pose_m = pose_of(number)
        observation = observed(pose_m, hidden or [])
        observation.range_m += rng.normal(0.0, noise_m, 17)
        (found,) = objects.update(PERIOD_S, people(pose_m), observation, [(posture, 0.9)])
    return found


def test_figure_that_never_moves_is_an_object_after_two_minutes() -> None:
    assert object_like(still) > 0.9
    assert object_like(still, frames=400) < 0.5


def test_swaying_person_is_no_object() -> None:
    assert object_like(swaying) < 0.2


@pytest.mark.parametrize("posture", ["sitting", "lying"])
def test_motionless_person_who_sits_or_lies_is_no_object(posture: Posture) -> None:
    assert object_like(still, posture=posture) < 0.01


@pytest.mark.parametrize("noise_m", [0.0, 0.006])
def test_screen_with_a_moving_person_is_an_object_after_three_seconds(noise_m: float) -> None:
    assert object_like(poster, frames=30, noise_m=noise_m) > 0.9
    assert object_like(poster, frames=10, noise_m=noise_m) < 0.01


def test_person_is_not_flat() -> None:
    assert object_like(swaying, frames=30) < 0.05


def test_few_readings_are_not_flat() -> None:
    assert object_like(poster, frames=30, hidden=list(range(7, 17))) < 0.2


def test_evidence_starts_again_after_a_restart() -> None:
    objects, observation = ObjectFilter(), observed(standing(), [])
    for _ in range(FRAMES):
        (before,) = objects.update(PERIOD_S, people(standing()), observation, [("standing", 0.9)])
    objects.restart()
    (after,) = objects.update(PERIOD_S, people(standing()), observation, [("standing", 0.9)])
    assert before > 0.9
    assert after < 0.01


def test_people_without_detections_keep_their_evidence() -> None:
    objects, observation = ObjectFilter(), observed(standing(), [])
    for _ in range(FRAMES):
        (before,) = objects.update(PERIOD_S, people(standing()), observation, [("standing", 0.9)])
    observation.confidence[:], observation.range_m[:] = 0.0, np.nan
    (after,) = objects.update(PERIOD_S, people(standing()), observation, [("unknown", 0.0)])
    assert after == before
