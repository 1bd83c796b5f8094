"""Views of people in the lab's rooms, different from all people of its cast.

Each scene has a few identities, each drawn several times: in different rooms, from different
cameras and distances, occluding each other, cut by the image's edge.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry.transforms import (
    LINK_FROM_OPTICAL,
    apply,
    camera_matrix,
    invert,
    project,
    rotation_from_rpy,
    transform_from,
    wrap,
)
from lab.bodies.skeleton import BodyPose
from lab.camera.plan import CameraPlan
from lab.drawing.mesh import Mesh, join
from lab.drawing.raster import homogeneous, rasterise
from lab.drawing.renderer import Instant, Renderer
from lab.drawing.rooms import room_mesh
from lab.motion.motion import PersonMotion, simulate
from lab.scenario import WALKABLE_M, Gesture, PersonPlan, RoomName, Waypoint
from lab.truth.frames import project_visible
from lab.world import camera_info
from people4d.messages import F32, F64, U8, CameraInfo
from scripts.render_people.outfits import DressedBody, Paint, Rng, draw_cut, draw_outfit

BOOL = npt.NDArray[np.bool_]
IMAGE_PX = (256, 192)
DARK_SCENES = 0.4  # share of scenes with dark clothes only
LAYER_M = (-0.4, 0.5)  # [m] depth range of the person's layer around its median
PEOPLE = 6  # number of people of a scene
PIXELS_MIN = 150  # minimum number of visible pixels of a person with a view
SHOULDERS = [5, 6]  # COCO keypoints; a view requires a visible one
MOTION_S = 24.0


@dataclass(frozen=True)
class Stage:
    """Bodies, motions and rooms of random scenes."""

    bodies: Sequence[DressedBody]
    motions: Sequence[PersonMotion]  # one for each body
    rooms: Sequence[tuple[RoomName, Renderer]]


@dataclass(frozen=True)
class PersonView:
    """View of one person in an image."""

    # HxWx3, 0 or 255: visible person, surfaces before the person, surfaces near the person's depth
    planes: U8
    box_px: F64  # left, top, right, bottom of the body with its hidden parts, in the image
    shoulders_px: F64  # u and v of the middle of the shoulders
    depth_m: float  # [m] depth of that point
    focal_px: float  # [px] focal length of the camera
    yaw_rad: float  # [rad] yaw of the chest, 0 = away along the line of sight, + to the left


@dataclass(frozen=True)
class Identity:
    """One person of a scene."""

    body: int  # index in the stage
    paint: Paint


def make_stage(rng: Rng, cuts: int, rooms: int) -> Stage:
    """Draw bodies with their motions, and rooms."""
    bodies = [DressedBody(draw_cut(rng)) for _ in range(cuts)]
    kinds: list[RoomName] = ["lab" if rng.random() < 0.5 else "hall" for _ in range(rooms)]
    return Stage(
        bodies,
        [draw_motion(rng, body) for body in bodies],
        [(kind, make_renderer(rng, kind)) for kind in kinds],
    )


def make_renderer(rng: Rng, kind: RoomName) -> Renderer:
    """Draw a room with a camera of a random focal length."""
    focal_px = float(rng.uniform(170, 260))
    plan = CameraPlan(width=IMAGE_PX[0], height=IMAGE_PX[1], focal_px=focal_px)
    seed = int(rng.integers(2**31))
    return Renderer(room_mesh(kind, seed), camera_info(plan), seed, samples=1)


def draw_motion(rng: Rng, body: DressedBody) -> PersonMotion:
    """Return a motion with walking, standing, turns of the head and a gesture."""
    path = tuple(
        Waypoint(
            to=(float(rng.uniform(1, 4)), float(rng.uniform(-1.4, 1.4))),
            speed_mps=float(rng.uniform(0.5, 1.3)),
            stop_s=float(rng.choice([0.0, 1.0, 2.0])),
            turn_head=bool(rng.random() < 0.5),
        )
        for _ in range(12)
    )
    gesture = Gesture(at_s=2.0, for_s=10.0, move="raise" if rng.random() < 0.3 else "before_torso")
    plan = PersonPlan(body="adam", start=(2.0, 0.0), path=path, gestures=(gesture,))
    return simulate([plan], [body.body.skeleton], MOTION_S, int(rng.integers(2**31)))[0]


def views_of_scene(rng: Rng, stage: Stage, images: int) -> Iterator[tuple[int, U8, PersonView]]:
    """Yield the views of one scene: number of the person, HxWx3 image, view.

    Half of the images show one room.
    """
    dark = bool(rng.random() < DARK_SCENES)
    people = [draw_identity(rng, stage, dark) for _ in range(PEOPLE)]
    home = int(rng.integers(len(stage.rooms)))
    for image in range(images):
        room = home if image < images // 2 else int(rng.integers(len(stage.rooms)))
        rgb, views = draw_image(rng, stage, people, room)
        for k, view in views.items():
            yield k, rgb, view


def draw_identity(rng: Rng, stage: Stage, dark: bool) -> Identity:
    """Draw a person."""
    body = int(rng.integers(len(stage.bodies)))
    pose = stage.motions[body].at(0.0)
    return Identity(body, stage.bodies[body].paint(draw_outfit(rng, dark), pose))


def draw_image(
    rng: Rng, stage: Stage, people: Sequence[Identity], number: int
) -> tuple[U8, dict[int, PersonView]]:
    """Draw the people in a room; return the image, and the views of visible people."""
    kind, renderer = stage.rooms[number]
    (left, low), (_, high) = WALKABLE_M[kind]
    at = np.array(
        [rng.uniform(left, left + 0.8), 0.7 * rng.uniform(low, high), rng.uniform(0.5, 2.5)]
    )
    target = np.array([left + 2.2, 0.0, rng.uniform(0.8, 1.3)]) + rng.normal(0, 0.3, 3)
    optical_from_map = invert(camera_pose(at, target, float(rng.normal(0, 0.08))))
    meshes, shoulders_m, yaws_rad = list[Mesh](), list[F64](), list[float]()
    taken = [at[:2]]
    for k, person in enumerate(people):
        taken.append(free_position(rng, kind, at, target, taken))
        pose = stage.motions[person.body].at(rng.uniform(0, MOTION_S))
        moved = moved_pose(pose, taken[-1], rng.uniform(0, 2 * np.pi))
        dressed = stage.bodies[person.body]
        meshes.append(dressed.mesh(moved, k + 1, person.paint))
        shoulders_m.append(dressed.body.keypoints_m(moved)[SHOULDERS])
        ahead, left = taken[-1] - at[:2]
        yaws_rad.append(wrap(dressed.body.chest_yaw(moved) - math.atan2(left, ahead)))
    rgb = renderer.exposed([Instant(meshes, optical_from_map)], int(rng.integers(2**31)))
    owners, depth_m = draw_owners([renderer.room.mesh, *meshes], optical_from_map, renderer.info)
    views = {}
    for k, points_m in enumerate(shoulders_m):
        own = owners == k + 1
        if np.count_nonzero(own) < PIXELS_MIN:
            continue
        column, row = np.rint(project_visible(apply(optical_from_map, points_m), renderer.info)).T
        inside = (column >= 0) & (column < own.shape[1]) & (row >= 0) & (row < own.shape[0])
        if own[row[inside].astype(int), column[inside].astype(int)].any():
            body_px = project_visible(apply(optical_from_map, meshes[k].vertices_m), renderer.info)
            middle_m = apply(optical_from_map, points_m).mean(axis=0)
            views[k] = view_of(own, depth_m, body_px, middle_m, renderer.info, yaws_rad[k])
    return rgb, views


def view_of(
    own: BOOL, depth_m: F32, body_px: F64, middle_m: F64, info: CameraInfo, yaw_rad: float
) -> PersonView:
    """Return the view of a person from their pixels, the depth image and the projected body.

    `middle_m` is the middle of the shoulders in the camera's frame.
    """
    relative_m = depth_m - np.median(depth_m[own])
    body_px = body_px[np.isfinite(body_px).all(axis=1)]
    box_px = np.concatenate([body_px.min(axis=0), body_px.max(axis=0)])
    size = np.array(own.shape[::-1] * 2)
    hidden = (relative_m < LAYER_M[0]) & ~own
    layer = (relative_m >= LAYER_M[0]) & (relative_m <= LAYER_M[1])
    return PersonView(
        np.dstack([own, hidden, layer]) * np.uint8(255),
        np.clip(box_px, 0, size),
        project(middle_m, info)[0],
        float(middle_m[2]),
        info.fx,
        yaw_rad,
    )


def draw_owners(meshes: Sequence[Mesh], optical_from_map: F64, info: CameraInfo) -> tuple[U8, F32]:
    """Return the image of person numbers, 0 = room, and the depth image [m]."""
    scene = join(meshes)
    corners = homogeneous(scene.vertices_m, camera_matrix(info) @ optical_from_map[:3])
    raster = rasterise(corners, scene.faces, (info.height, info.width))
    return np.append(scene.owner, 0).astype(np.uint8)[raster.triangle], raster.depth_m()


def camera_pose(at: F64, target: F64, roll_rad: float) -> F64:
    """Return the pose, in the map, of an optical frame at a point that looks at another."""
    ahead = target - at
    pitch = -np.arctan2(ahead[2], np.hypot(*ahead[:2]))
    rotation = rotation_from_rpy(roll_rad, float(pitch), float(np.arctan2(ahead[1], ahead[0])))
    return np.asarray(transform_from(at, rotation) @ LINK_FROM_OPTICAL)


def free_position(rng: Rng, kind: RoomName, at: F64, target: F64, taken: Sequence[F64]) -> F64:
    """Draw a position (x, y) on the free floor before the camera, 0.45 m from the others."""
    while True:
        where = draw_position(rng, kind, at, target)
        if where is not None and is_apart(where, taken, 0.45):
            return where


def draw_position(rng: Rng, kind: RoomName, at: F64, target: F64) -> F64 | None:
    """Draw a position (x, y) before the camera; None if it is not on the floor."""
    (left, low), (right, high) = WALKABLE_M[kind]
    axis = np.arctan2(*(target - at)[1::-1])
    distance = rng.uniform(0.7, min(5.5, right - at[0]))
    angle = axis + rng.uniform(-0.45, 0.45)
    where = np.asarray(at[:2] + distance * np.array([np.cos(angle), np.sin(angle)]))
    inside = left <= where[0] <= right and low <= where[1] <= high
    return where if inside else None


def is_apart(where: F64, taken: Sequence[F64], distance_m: float) -> bool:
    """Return True if a position is farther than a distance from all others."""
    return all(np.hypot(*(where - other)) > distance_m for other in taken)


def moved_pose(pose: BodyPose, where: F64, turn_rad: float) -> BodyPose:
    """Return a pose turned about the vertical and moved to a position (x, y)."""
    own = pose.map_from_pelvis
    turn = rotation_from_rpy(0.0, 0.0, turn_rad)
    moved = np.eye(4)
    moved[:3, :3] = turn @ own[:3, :3]
    moved[:3, 3] = [*where, own[2, 3]]
    return BodyPose(moved, pose.rotations)
