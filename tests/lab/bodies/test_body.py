"""Bodies: their joints, skin and keypoints follow the pose."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import lab
from lab.bodies.body import SkinnedBody, load_body
from lab.bodies.cast import cast_names
from lab.bodies.figure import load_figure
from lab.bodies.rig import BONES, NAMES
from lab.bodies.rotations import about_x, about_y, about_z
from lab.bodies.skeleton import INDEX, PARENTS, BodyPose, Skeleton, map_from_segments
from lab.drawing.mesh import Material, Mesh
from people4d.errors import ConfigError
from people4d.messages import F64

ASSETS = Path(lab.__file__).parent / "assets"
EVERYBODY = pytest.mark.parametrize("name", cast_names())
# Joint that a segment turns about, and position of its end.
JOINT_OF = {
    "chest": "waist",
    "upper_arm": "shoulder",
    "forearm": "elbow",
    "thigh": "hip",
    "shank": "knee",
    "foot": "ankle",
}


def neutral() -> BodyPose:
    return BodyPose(np.eye(4), np.tile(np.eye(3), (len(PARENTS), 1, 1)))


def striding() -> BodyPose:
    """Return the pose of a person walking and looking aside, in the room."""
    pose = neutral()
    pose.map_from_pelvis[:3, :3] = about_z(2.0) @ about_x(0.04)
    pose.map_from_pelvis[:3, 3] = (3.0, -0.5, 0.95)
    turns = {
        "chest": about_z(0.15) @ about_y(0.05),
        "head": about_z(0.5),
        "upper_arm_l": about_y(0.4) @ about_x(0.1),
        "forearm_l": about_y(-0.5),
        "upper_arm_r": about_y(-0.4),
        "thigh_l": about_y(-0.5) @ about_x(-0.05),
        "shank_l": about_y(0.3),
        "thigh_r": about_y(0.3),
        "shank_r": about_y(0.7),
        "foot_r": about_y(0.3),
    }
    for name, turn in turns.items():
        pose.rotations[INDEX[name]] = turn
    return pose


def forward_kinematics(skeleton: Skeleton, pose: BodyPose) -> dict[str, F64]:
    """Return the joint of each segment, from the skeleton's points alone."""
    rotations = map_from_segments(pose)
    rest = {"pelvis": np.zeros(3)}
    positions = {"pelvis": pose.map_from_pelvis[:3, 3]}
    for segment, parent in PARENTS.items():
        if segment in ("pelvis", "head"):  # the neck is no point of the skeleton
            continue
        joint = getattr(skeleton, JOINT_OF[segment.removesuffix("_l").removesuffix("_r")])
        rest[segment] = joint if joint.ndim == 1 else joint["lr".index(segment[-1])]
        positions[segment] = positions[parent] + rotations[INDEX[parent]] @ (
            rest[segment] - rest[parent]
        )
    return positions


def test_assets_are_small() -> None:
    size = sum((ASSETS / name).stat().st_size for name in ("bodies.npz", "cast.toml"))
    assert size < 4e6


def test_the_asset_has_the_bones_that_are_turned() -> None:
    # Toes bend with the shoe, which the bare figure does not have.
    assert (*load_figure("adam").bones, "toe_l", "toe_r") == NAMES


def test_ten_people_of_different_stature() -> None:
    statures = [load_body(name).skeleton.stature_m for name in cast_names()]
    assert len(statures) >= 10
    assert min(statures) < 1.52
    assert max(statures) > 1.90


def test_unknown_name_is_refused() -> None:
    with pytest.raises(ConfigError, match="unknown person zoe"):
        load_body("zoe")


@EVERYBODY
def test_stands_on_flat_soles(name: str) -> None:
    body = load_body(name)
    skeleton, mesh = body.skeleton, body.mesh(neutral(), 1)
    floor = mesh.vertices_m[:, 2].min()
    for points in (skeleton.heel, skeleton.ball, skeleton.toe):
        assert_allclose(points[:, 2], floor, atol=1e-6)
    assert_allclose(np.ptp(mesh.vertices_m[:, 2]), skeleton.stature_m)
    assert np.all(skeleton.heel[:, 0] < skeleton.ankle[:, 0])
    assert np.all(skeleton.ankle[:, 0] < skeleton.ball[:, 0])
    assert np.all(skeleton.ball[:, 0] < skeleton.toe[:, 0])


@EVERYBODY
def test_skeleton_is_a_human_one(name: str) -> None:
    skeleton = load_body(name).skeleton
    assert_allclose(skeleton.hip.mean(axis=0), 0, atol=1e-6)
    # Knees are below the hips, and both legs are equal.
    assert_allclose(skeleton.knee[:, 1], skeleton.hip[:, 1], atol=1e-4)
    assert_allclose(skeleton.knee[0] * (1, -1, 1), skeleton.knee[1], atol=2e-3)
    # Winter's mean proportions: hip at 0.53 of the stature, shoulder at 0.82; people differ.
    sole = skeleton.heel[0, 2]
    assert 0.48 < -sole / skeleton.stature_m < 0.56
    assert 0.76 < (skeleton.shoulder[0, 2] - sole) / skeleton.stature_m < 0.86


@EVERYBODY
def test_joints_are_where_forward_kinematics_puts_them(name: str) -> None:
    body, pose = load_body(name), striding()
    transforms = body.bones(pose)
    rest = forward_kinematics(body.skeleton, neutral())
    for segment, position in forward_kinematics(body.skeleton, pose).items():
        transform = transforms[NAMES.index(segment)]
        assert_allclose(transform[:, :3] @ rest[segment] + transform[:, 3], position, atol=1e-9)


def test_toes_lie_on_the_floor_when_the_heel_rises() -> None:
    # The foot rolls about its ball: the heel up by 0.4 rad, the ball on the floor.
    body, pose = load_body("adam"), neutral()
    pose.rotations[INDEX["foot_l"]] = about_y(0.4)
    skeleton, roll = body.skeleton, about_y(0.4)
    ball = skeleton.ankle[0] + roll @ (skeleton.ball[0] - skeleton.ankle[0])
    pose.map_from_pelvis[2, 3] = -ball[2]
    left = body.mesh(pose, 1).vertices_m
    left = left[left[:, 1] > 0.02]
    assert left[:, 2].min() > -0.006
    toe = body.bones(pose)[NAMES.index("toe_l")]
    assert_allclose(toe[:, :3], np.eye(3), atol=1e-3)  # soles point a little outwards
    assert_allclose(toe[:, :3] @ skeleton.ball[0] + toe[:, 3], (ball[0], ball[1], 0), atol=1e-9)
    # In the air they are stretched.
    pose.map_from_pelvis[2, 3] += 0.3
    assert_allclose(body.bones(pose)[NAMES.index("toe_l"), :, :3], roll, atol=1e-9)


def test_bones_turn_with_their_segments() -> None:
    pose = striding()
    transforms, segments = load_body("bea").bones(pose), map_from_segments(pose)
    for index, bone in enumerate(BONES.values()):
        rotation = transforms[index, :, :3]
        assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        if not bone.other:
            assert_allclose(rotation, segments[INDEX[bone.segment]], atol=1e-12)


def test_half_bone_turns_halfway() -> None:
    # The knee bends by 0.8 rad about y; the bone between thigh and shank by 0.4.
    pose = neutral()
    pose.rotations[INDEX["shank_l"]] = about_y(0.8)
    transform = load_body("bea").bones(pose)[NAMES.index("knee_l")]
    assert_allclose(transform[:, :3], about_y(0.4), atol=1e-12)


@EVERYBODY
def test_keypoints_lie_in_the_body_and_left_is_left(name: str) -> None:
    body = load_body(name)
    keypoints, vertices = body.keypoints_m(neutral()), body.mesh(neutral(), 1).vertices_m
    assert keypoints.shape == (17, 3)
    assert np.all(keypoints > vertices.min(axis=0))
    assert np.all(keypoints < vertices.max(axis=0))
    left, right = keypoints[1::2], keypoints[2::2]
    assert np.all(left[:, 1] > 0.02)
    assert_allclose(left * (1, -1, 1), right, atol=2e-3)
    # From top to bottom: eyes, shoulders, elbows, hips, knees, ankles; the nose is in front.
    assert np.all(np.diff(keypoints[[1, 5, 7, 11, 13, 15], 2]) < -0.1)
    assert keypoints[0, 0] > keypoints[1, 0] > keypoints[3, 0]


@EVERYBODY
def test_keypoints_stay_in_the_body_that_moves(name: str) -> None:
    body, pose = load_body(name), striding()
    vertices = body.mesh(pose, 1).vertices_m
    for keypoint in body.keypoints_m(pose):
        # The skin is nearer than the thickest part of a body.
        assert np.linalg.norm(vertices - keypoint, axis=1).min() < 0.12


def test_ankles_are_the_joints() -> None:
    body = load_body("adam")
    assert_allclose(body.keypoints_m(neutral())[15:], body.skeleton.ankle, atol=1e-6)


def test_moving_the_room_moves_the_mesh_rigidly() -> None:
    body, pose = load_body("hana"), striding()
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = about_z(-0.7), (1.0, 2.0, 0.3)
    moved = BodyPose(motion @ pose.map_from_pelvis, pose.rotations)
    before, after = body.mesh(pose, 1), body.mesh(moved, 1)
    turned = before.vertices_m @ motion[:3, :3].T + motion[:3, 3]
    assert_allclose(after.vertices_m, turned, atol=1e-9)
    assert_allclose(after.normals, before.normals @ motion[:3, :3].T, atol=1e-9)
    assert_allclose(
        body.keypoints_m(moved), body.keypoints_m(pose) @ motion[:3, :3].T + motion[:3, 3]
    )
    assert body.chest_yaw(moved) == pytest.approx(body.chest_yaw(pose) - 0.7)


def test_neutral_posture_leaves_the_body_as_baked() -> None:
    assert_allclose(load_body("erik").bones(neutral()), np.tile(np.eye(3, 4), (len(NAMES), 1, 1)))


def test_chest_yaw_is_the_chests() -> None:
    pose = neutral()
    pose.map_from_pelvis[:3, :3] = about_z(np.pi / 2)
    pose.rotations[INDEX["chest"]] = about_z(0.25)
    pose.rotations[INDEX["head"]] = about_z(-0.6)
    assert load_body("adam").chest_yaw(pose) == pytest.approx(np.pi / 2 + 0.25)


@EVERYBODY
def test_normals_point_outwards(name: str) -> None:
    mesh = load_body(name).mesh(neutral(), 3)
    assert set(mesh.owner.tolist()) == {3}
    assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-6)
    for material in Material.SKIN, Material.SHIRT, Material.TROUSERS, Material.SHOE, Material.EYE:
        assert flux(mesh, material) > 0


def flux(mesh: Mesh, material: Material) -> float:
    """Return the sum over triangles of area, times how far they face away from their middle."""
    a, b, c = (mesh.vertices_m[mesh.faces[mesh.material == material, i]] for i in range(3))
    middles = (a + b + c) / 3
    # Left and right are separate: the midpoint of two legs belongs to neither.
    side = np.sign(middles[:, 1])[:, None] == np.array([[1.0, -1.0]])
    centres = np.array([middles[side[:, i]].mean(axis=0) for i in range(2)])
    away = middles - centres[side.argmax(axis=1)]
    return float(np.sum(np.cross(b - a, c - a) * away))


def test_bending_keeps_triangles_from_tearing() -> None:
    # Sitting: hips and knees bent by a right angle. Edges of cloth stay shorter than a hand.
    pose = neutral()
    for side in "lr":
        pose.rotations[INDEX[f"thigh_{side}"]] = about_y(-1.5)
        pose.rotations[INDEX[f"shank_{side}"]] = about_y(1.5)
    for name in ("adam", "joy", "hana"):
        mesh = load_body(name).mesh(pose, 1)
        edges = mesh.vertices_m[mesh.faces] - mesh.vertices_m[np.roll(mesh.faces, 1, axis=1)]
        assert np.linalg.norm(edges, axis=2).max() < 0.12


def shirt_colour(body: SkinnedBody) -> F64:
    mesh = body.mesh(neutral(), 1)
    used = np.unique(mesh.faces[mesh.material == Material.SHIRT])
    mean: F64 = mesh.colour[used].mean(axis=0).astype(np.float64)
    return mean


def test_seed_changes_shades_a_little() -> None:
    first, second = shirt_colour(load_body("bea", seed=1)), shirt_colour(load_body("bea", seed=2))
    assert np.any(first != second)
    assert_allclose(first, second, rtol=0.2)
