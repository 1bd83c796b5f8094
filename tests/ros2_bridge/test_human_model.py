"""Kinematic model of a body: its URDF at its angles has the joints of the skeleton."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from common.ros2.messages.human_model import (
    ARMS,
    LEGS,
    LENGTHS_M,
    NAMES,
    bone_lengths,
    joint_angles,
    urdf,
)
from people4d.messages import F64

LENGTHS = np.array([0.17, 0.2, 0.5, 0.28, 0.25, 0.4, 0.41])


def links(text: str, angles_rad: dict[str, float]) -> dict[str, F64]:
    """Return body_from_link of all links by the joints of a URDF."""
    robot = ET.fromstring(text)
    poses = {"body_b7": np.eye(4)}
    for joint in robot.findall("joint"):
        found = {one.tag: dict(one.attrib) for one in joint}
        step = np.eye(4)
        step[:3, 3] = [float(v) for v in found["origin"]["xyz"].split()]
        if "axis" in found:
            axis = np.array([float(v) for v in found["axis"]["xyz"].split()])
            name = joint.attrib["name"].removesuffix("_b7")
            step[:3, :3] = Rotation.from_rotvec(axis * angles_rad.pop(name)).as_matrix()
        poses[found["child"]["link"]] = poses[found["parent"]["link"]] @ step
    assert not angles_rad  # every published joint is a joint of the URDF
    assert set(poses) == {one.attrib["name"] for one in robot.findall("link")}
    return poses


def body(seed: int, waist_rad: float) -> F64:
    """Return the joints of a body with limbs in random directions, in the axes of `body`."""
    rng = np.random.default_rng(seed)
    half, hips, torso, *limbs = LENGTHS.tolist()
    joints = np.zeros((17, 3))
    joints[[11, 12], 1], joints[[11, 12], 2] = (hips / 2, -hips / 2), -torso / 2
    turn = Rotation.from_rotvec((0.0, waist_rad, 0.0)).as_matrix()
    base = joints[[11, 12]].mean(axis=0)
    joints[[5, 6]] = base + [turn @ (0.0, side, torso) for side in (half, -half)]
    head = base + turn @ (0.0, 0.0, torso + 0.2)
    joints[[3, 4]] = head + [turn @ (0.0, side, 0.0) for side in (0.07, -0.07)]
    joints[0] = head + turn @ (0.1 * np.cos(0.3), 0.0, -0.1 * np.sin(0.3))  # 0.3 rad down
    for pair, (upper, lower) in ((ARMS, limbs[:2]), (LEGS, limbs[2:])):
        for a, b, c in pair:
            first, second = rng.normal(size=(2, 3))
            joints[b] = joints[a] + upper * first / np.linalg.norm(first)
            joints[c] = joints[b] + lower * second / np.linalg.norm(second)
    return joints


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("waist_rad", [0.0, 0.7])
def test_urdf_at_the_angles_has_the_joints_of_the_skeleton(seed: int, waist_rad: float) -> None:
    joints = body(seed, waist_rad)
    found = links(urdf("b7", LENGTHS), dict(zip(NAMES, joint_angles(joints), strict=True)))
    names = {"shoulder": 5, "elbow": 7, "wrist": 9, "hip": 11, "knee": 13, "ankle": 15}
    for name, number in names.items():
        for side, k in (("l", number), ("r", number + 1)):
            at_m = found[f"{side}_{name}_b7"][:3, 3]
            assert at_m == pytest.approx(joints[k], abs=2e-4), (side, name)


def test_head_faces_along_the_nose() -> None:
    angles = dict(zip(NAMES, joint_angles(body(0, 0.4)), strict=True))
    ahead = links(urdf("b7", LENGTHS), angles)["head_b7"][:3, 0]
    assert ahead == pytest.approx([np.cos(0.7), 0.0, -np.sin(0.7)], abs=1e-6)


def test_knee_bends_backward_and_elbow_forward_without_turning_the_limb() -> None:
    joints = body(0, 0.0)
    for _, b, c in ARMS:
        joints[b], joints[c] = joints[b - 2] + (0, 0, -0.28), joints[b - 2] + (0.25, 0, -0.28)
    for _, b, c in LEGS:
        joints[b], joints[c] = joints[b - 2] + (0, 0, -0.4), joints[b - 2] + (-0.41, 0, -0.4)
    angles = dict(zip(NAMES, joint_angles(joints), strict=True))
    for side in "lr":
        assert angles[f"{side}_elbow"] == pytest.approx(np.pi / 2)
        assert angles[f"{side}_knee"] == pytest.approx(-np.pi / 2)
        assert angles[f"{side}_y_hip"] == pytest.approx(0.0)


def test_lengths_of_a_skeleton_are_the_lengths_of_its_bones() -> None:
    assert bone_lengths(body(3, 0.5)) == pytest.approx(LENGTHS)


def test_default_lengths_have_a_stature_of_human_description() -> None:
    _, _, torso, upper, fore, thigh, shank = LENGTHS_M.tolist()
    assert thigh + shank + torso + 1.25 * torso / 2.75 == pytest.approx(1.65, abs=1e-6)
    assert upper / fore == pytest.approx(1.6)


def test_missing_joints_give_finite_angles() -> None:
    assert np.isfinite(joint_angles(np.zeros((17, 3)))).all()
