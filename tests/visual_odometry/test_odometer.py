"""Motion of a base from rendered images of a room."""

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from people4d.messages import F64
from services.visual_odometry.config import VisualOdometryConfig
from services.visual_odometry.corners import PeopleRegions, ReducedCamera
from services.visual_odometry.keyframe import PoseEstimate
from services.visual_odometry.odometer import COUNTERS, Odometer
from services.visual_odometry.reprojection import BaseMount
from tests.visual_odometry.room import (
    BASE_FROM_OPTICAL,
    FOCAL,
    HEIGHT,
    INFO,
    WIDTH,
    Board,
    as_view,
    base,
    view,
)

CONFIG = VisualOdometryConfig()
PLAIN = np.full((HEIGHT, WIDTH), 90, np.uint8)


def odometer(config: VisualOdometryConfig = CONFIG) -> tuple[Odometer, Counter[str]]:
    counters = Counter(dict.fromkeys(COUNTERS, 0))
    lens = ReducedCamera(INFO, config.width_px)
    mount = BaseMount(BASE_FROM_OPTICAL, config.planar)
    return Odometer(config, lens, mount, counters), counters


def off(pose_found: PoseEstimate | None, true: F64) -> tuple[float, float]:
    """Metres and radians."""
    assert pose_found is not None
    motion = np.linalg.inv(true) @ pose_found.matrix
    return float(np.linalg.norm(motion[:3, 3])), abs(math.atan2(motion[1, 0], motion[0, 0]))


def follow(
    one: Odometer, poses: Iterable[F64], boards: tuple[Board, ...] = ()
) -> list[PoseEstimate | None]:
    return [
        one.add_frame(view(pose, number, boards, noise_seed=number))
        for number, pose in enumerate(poses)
    ]


def test_pose_of_a_driving_and_turning_base_is_accurate() -> None:
    """Twenty frames of 2 cm and 2 degrees each: never more than 1.5 cm and 0.4 degrees off."""
    poses = [base(0.0)]
    for _ in range(20):
        poses.append(poses[-1] @ base(0.02, 0.0, math.radians(2)))
    one, counters = odometer()
    poses_found = follow(one, poses)
    assert poses_found[0] is not None
    assert np.array_equal(poses_found[0].matrix, np.eye(4))
    assert not poses_found[0].covariance.any()
    for pose_found, pose in zip(poses_found, poses, strict=True):
        metres, radians = off(pose_found, pose)
        assert metres < 0.015
        assert radians < math.radians(0.4)
    assert counters["keyframes"] > 1  # 40 degrees are two thirds of the field of view
    assert counters["lost"] == 0


@pytest.mark.slow
def test_standing_base_does_not_drift() -> None:
    """Twenty noisy images of one view: one keyframe, and no growing error."""
    one, counters = odometer()
    poses_found = follow(one, [base()] * 20)
    offs = np.array([off(pose_found, base()) for pose_found in poses_found])
    assert offs[:, 0].max() < 0.003
    assert offs[:, 1].max() < math.radians(0.1)
    assert counters["keyframes"] == 1


@pytest.mark.slow
def test_base_that_turns_back_uses_the_first_keyframe_again() -> None:
    """40 degrees to the left and back: the last error is the error of one image."""
    angles = [20 * (1 - math.cos(math.pi * k / 15)) for k in range(31)]
    one, counters = odometer()
    poses_found = follow(one, [base(theta_rad=math.radians(a)) for a in angles])
    assert off(poses_found[-1], base())[1] < math.radians(0.1)
    assert counters["keyframes_met_again"] > 0
    last = poses_found[-1]
    assert last is not None
    assert max(p.covariance[2, 2] for p in poses_found if p) > last.covariance[2, 2]


@pytest.mark.slow
def test_error_is_within_its_covariance() -> None:
    """After five keyframes yaw and position are within three standard deviations."""
    poses = [base(theta_rad=math.radians(4 * k)) for k in range(30)]
    one, _ = odometer()
    poses_found = follow(one, poses)
    metres, radians = off(poses_found[-1], poses[-1])
    last = poses_found[-1]
    assert last is not None
    sigmas = np.sqrt(np.diag(last.covariance))
    assert radians < 3 * sigmas[2]
    assert metres < 3 * math.hypot(sigmas[0], sigmas[1])
    assert sigmas[2] < math.radians(2)


@pytest.mark.slow
def test_walking_person_does_not_move_the_camera() -> None:
    """An undetected person, a third of the image wide, crosses at 2 m by 6 cm a frame."""
    one, _ = odometer()
    for number in range(25):
        walker = Board(x_m=2.0, y_m=1.0 - 0.06 * number, half_m=0.3)
        pose_found = one.add_frame(view(base(), number, (walker,), noise_seed=number))
        metres, radians = off(pose_found, base())
        assert metres < 0.004
        assert radians < math.radians(0.15)


def test_detected_person_in_most_of_the_image_does_not_move_the_camera() -> None:
    """A person at 1.1 m, in 70 % of the image, moves 2 cm a frame to the left."""
    half_px, step_px = 0.4 / 1.0 * FOCAL, 0.02 / 1.0 * FOCAL
    box = np.array([[WIDTH / 2 - half_px, 0.0, WIDTH / 2 + half_px, HEIGHT]])
    one, _ = odometer()
    for number in range(12):
        walker = Board(x_m=1.1, y_m=0.02 * number, half_m=0.35)
        image = view(base(), number, (walker,), noise_seed=number)
        pose_found = one.add_frame(
            replace(
                image,
                people=PeopleRegions(
                    box - [number * step_px, 0, number * step_px, 0], np.array([1.0])
                ),
            )
        )
        assert off(pose_found, base())[0] < 0.01


def test_late_detections_mark_the_landmarks_of_their_keyframe() -> None:
    one, _ = odometer()
    one.add_frame(view(base(), 0, (Board(x_m=2.0, y_m=0.0, half_m=0.4),)))
    edge_px = 0.4 / 1.9 * FOCAL
    people = PeopleRegions(
        np.array([[WIDTH / 2 - edge_px, 0.0, WIDTH / 2 + edge_px, HEIGHT]]), np.array([1.9])
    )
    one.mark_people(12345, people)
    assert not one._keyframes[-1].points.people.any()
    one.mark_people(0, people)
    points = one._keyframes[-1].points
    assert 0 < points.people.sum() < len(points.pixels) - 10
    inside = np.abs(points.pixels[:, 0] - WIDTH / 2) < edge_px
    assert points.people[inside & (np.abs(points.positions_m[:, 2] - 1.9) < 0.3)].all()


def test_no_pose_if_all_points_may_be_on_people() -> None:
    """A person of unknown depth in the whole image: no point is surely in the room."""
    one, counters = odometer()
    one.add_frame(view(base(), 0))
    one.mark_people(0, PeopleRegions(np.array([[0.0, 0.0, WIDTH, HEIGHT]]), np.array([np.nan])))
    assert one.add_frame(view(base(0.02), 1)) is None
    assert counters["not_followed"] == 1


def test_carried_camera_moves_freely() -> None:
    lift = base()
    lift[2, 3] = 0.05
    one, _ = odometer(VisualOdometryConfig(planar=False))
    one.add_frame(view(base(), 0))
    metres, _ = off(one.add_frame(view(lift, 1)), lift)
    assert metres < 0.005


@pytest.mark.parametrize(
    ("grey", "depth_m", "cause"),
    [(PLAIN, 2.0, "no_texture"), (None, 0.0, "no_depth"), (None, 20.0, "no_depth")],
)
def test_without_texture_or_depth_there_is_no_motion(
    grey: np.ndarray | None, depth_m: float, cause: str
) -> None:
    one, counters = odometer()
    for number in range(4):
        pattern = view(base()).rgb[..., 0] if grey is None else grey
        blind = as_view(pattern, np.full((HEIGHT, WIDTH), depth_m), number)
        pose_found = one.add_frame(blind)
        assert (pose_found is None) == (number > 0)  # the first pose is known by definition
    assert counters[cause] == 4
    # With texture and depth the poses continue, with a large covariance.
    assert one.add_frame(view(base(), 5)) is None
    pose_found = one.add_frame(view(base(), 6))
    assert pose_found is not None
    assert pose_found.covariance[2, 2] > 0


def test_short_darkness_is_bridged() -> None:
    """Three dark frames have no pose; later poses are as accurate as earlier ones."""
    one, counters = odometer()
    follow(one, [base()] * 3)
    for number in (3, 4, 5):
        assert one.add_frame(as_view(0 * PLAIN, np.full(PLAIN.shape, 2.0), number)) is None
    assert counters["not_followed"] == 3
    assert off(one.add_frame(view(base(), 6)), base())[0] < 0.003
    assert counters["lost"] == 0


def test_lost_base_has_a_large_covariance() -> None:
    """The base turns by 90 degrees while the lens is covered for a second."""
    one, counters = odometer()
    follow(one, [base()] * 3)
    for number in range(3, 18):
        assert one.add_frame(as_view(0 * PLAIN, np.full(PLAIN.shape, 2.0), number)) is None
    turned = base(theta_rad=math.pi / 2)
    assert one.add_frame(view(turned, 18)) is None
    pose_found = one.add_frame(view(turned, 19))
    assert counters["lost"] == 1
    assert pose_found is not None
    assert math.sqrt(pose_found.covariance[2, 2]) > 0.8  # [rad] half of 2 rad/s^2 for 1.07 s: 1.1
    step = one.add_frame(view(turned @ base(0.03), 20))
    assert step is not None
    motion = np.linalg.inv(pose_found.matrix) @ step.matrix
    assert motion[0, 3] == pytest.approx(0.03, abs=0.003)  # accurate from here on


def test_too_fast_motion_is_implausible() -> None:
    """Half a metre in a fifteenth of a second is 7.5 m/s, above 4 m/s."""
    one, counters = odometer()
    one.add_frame(view(base(), 0))
    one.add_frame(view(base(0.01), 1))
    assert one.add_frame(view(base(0.5), 2)) is None
    assert counters["implausible"] + counters["not_followed"] + counters["too_few_agree"] == 1


def test_a_wide_image_is_reduced() -> None:
    """Half the width gives the same motion."""
    one, _ = odometer(VisualOdometryConfig(width_px=160))
    one.add_frame(view(base(), 0))
    assert one._keyframes[-1].grey.shape == (HEIGHT // 2, WIDTH // 2)
    metres, radians = off(one.add_frame(view(base(0.02, 0.0, 0.05), 1)), base(0.02, 0.0, 0.05))
    assert metres < 0.006
    assert radians < math.radians(0.3)
