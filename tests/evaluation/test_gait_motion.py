"""Angles of the legs by hand, over the cycle of a walk whose steps are known."""

import numpy as np
import pytest

from evaluation.gait.motion import ANGLE_FIELDS, JointMotion, angle_rows, leg_angles, motion_of
from evaluation.gait.tables import GaitTables
from people4d.messages import F64, PersonSkeleton, Skeletons
from people4d.messages.skeleton import JOINTS
from services.gait.steps.steps import FootStep, Stride


def pose(thigh_rad: float = 0.0, shank_rad: float = 0.0, torso_rad: float = 0.0) -> F64:
    """Return the joints of a person who looks along x: segments ahead of vertical, downwards."""
    joints_m = np.zeros((17, 3))
    for side, y_m in (("left", 0.1), ("right", -0.1)):
        hip_m = np.array([0.0, y_m, 0.9])
        knee_m = hip_m + 0.4 * np.array([np.sin(thigh_rad), 0.0, -np.cos(thigh_rad)])
        ankle_m = knee_m + 0.4 * np.array([np.sin(shank_rad), 0.0, -np.cos(shank_rad)])
        shoulder_m = hip_m - 0.5 * np.array([np.sin(torso_rad), 0.0, -np.cos(torso_rad)])
        named = {"hip": hip_m, "knee": knee_m, "ankle": ankle_m, "shoulder": shoulder_m}
        for name, position_m in named.items():
            joints_m[JOINTS.index(f"{side}_{name}")] = position_m
    return joints_m


@pytest.mark.parametrize(
    ("segments", "expected"),
    [
        ((), (0, 0, 0)),  # stands upright
        ((np.pi / 2,), (90, 90, 0)),  # sits
        ((0.5, 0.5), (28.65, 0, -28.65)),  # stretched leg ahead
        ((0.0, -0.5), (0, 28.65, 28.65)),  # shank back
        ((0.0, 0.0, -0.5), (28.65, 0, 0)),  # bent trunk
    ],
)
def test_angles_of_a_pose_by_hand(
    segments: tuple[float, ...], expected: tuple[float, float, float]
) -> None:
    assert leg_angles(pose(*segments)[None])[0] == pytest.approx(np.tile(expected, (2, 1)), abs=0.1)


def test_angles_do_not_depend_on_the_direction_of_the_walk() -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    both = np.stack([one := pose(0.4, -0.3, 0.1), one @ turn.T])
    assert leg_angles(both)[0] == pytest.approx(leg_angles(both)[1])


def test_mean_and_spread_over_strides() -> None:
    # The thigh is at 0.1 rad in the first stride of the left foot, and at 0.3 rad in the second.
    times_s = np.arange(0, 3, 0.1)
    joints_m = np.stack([pose(0.1 if time_s < 1.45 else 0.3) for time_s in times_s])
    rows = [
        dict(zip(ANGLE_FIELDS, row, strict=True))
        for row in angle_rows(7, JointMotion(0.0, 10.0, joints_m), [landing(1.4), landing(2.4)])
    ]
    assert [row["cycle_percent"] for row in rows] == list(range(101))
    assert {(row["person"], row["foot"], row["strides"]) for row in rows} == {(7, "left", 2)}
    early, late = rows[30], rows[50]
    assert early["hip_mean_deg"] == pytest.approx(np.degrees(0.2))
    assert early["hip_sd_deg"] == pytest.approx(np.degrees(0.2 / np.sqrt(2)))
    assert early["ankle_mean_deg"] == pytest.approx(0, abs=1e-6)
    assert str(late["ankle_mean_deg"]) == "nan"  # the heel has left the floor


def landing(time_s: float) -> FootStep:
    stride = Stride(length_m=1.2, time_s=0.9, step_time_s=0.5)
    return FootStep("left", time_s, 0.6, stride, time_s - 0.4, (0.0, 0.0), 0.1, 1.0)


def test_joints_are_interpolated_in_short_gaps_only() -> None:
    times_s = [0.0, 0.1, 0.3, 0.4, 0.9, 1.0]
    motion = motion_of(times_s, [skeleton(time_s) for time_s in times_s])
    assert motion is not None
    assert motion.rate_hz == pytest.approx(10)
    expected = [0, 0.1, 0.2, 0.3, 0.4, *[np.nan] * 4, 0.9, 1.0]
    assert motion.joints_m[:, 5, 0] == pytest.approx(expected, nan_ok=True)


def test_motion_has_the_times_of_the_recording_from_stamp_zero() -> None:
    tables = GaitTables()
    for stamp_ns in (0, 200_000_000, 400_000_000):
        tables.add_skeletons(
            Skeletons(
                stamp_ns=stamp_ns,
                sequence=0,
                camera="front",
                frame_id="map",
                people=(skeleton(stamp_ns / 1e9),),
            )
        )
    motion = tables.motion(1)
    assert motion is not None
    assert motion.times_s == pytest.approx(motion.joints_m[:, 0, 0])
    assert motion.times_s == pytest.approx([0.0, 0.2, 0.4])


def test_uncertain_joint_is_unknown() -> None:
    motion = motion_of([0.0, 0.1], [skeleton(0.0), skeleton(0.1, sigma_m=0.3)])
    assert motion is not None
    assert motion.joints_m[:, 5, 0] == pytest.approx([0.0, np.nan], nan_ok=True)
    assert motion_of([0.0], [skeleton(0.0)]) is None


def skeleton(x_m: float, sigma_m: float = 0.02) -> PersonSkeleton:
    return PersonSkeleton(
        id=1,
        state="confirmed",
        positions_m=np.full((17, 3), x_m, np.float32),
        covariances_m2=np.tile(sigma_m**2 * np.eye(3, dtype=np.float32), (17, 1, 1)),
        measured=(True,) * 17,
    )
