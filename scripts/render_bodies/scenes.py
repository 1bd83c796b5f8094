"""Scenes of people, of things that look like people, and of furniture."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from common.geometry.transforms import apply, invert
from lab.drawing.mesh import Material, Mesh, join
from lab.drawing.pieces import KINDS, moved
from lab.drawing.solids import Finish, box
from lab.scenario import WALKABLE_M, RoomName
from people4d.messages import F64
from scripts.render_bodies.labels import Kind
from scripts.render_people.outfits import Rng
from scripts.render_people.views import (
    MOTION_S,
    Identity,
    Stage,
    camera_pose,
    draw_position,
    is_apart,
    moved_pose,
)

TORSO = [5, 6, 11, 12]  # COCO keypoints whose mean is the middle of the torso
APART_M = 0.42  # minimum distance between positions [m]
TRIES = 60  # maximum number of draws of a free position
FURNITURE_OWNER = 100  # owner of the first piece of furniture, after all people
# Cumulative shares of people that become flat figures, mannequins and robots
FLAT_FIGURES, MANNEQUINS, ROBOTS = 0.06, 0.12, 0.2
SLOPE = 0.4  # maximum slope of a flat figure across the view
RELIEF = 0.02  # depth of a flat figure relative to a body
BOARDS = (Material.WOOD, Material.FABRIC, Material.METAL, Material.PAINT, Material.BOOKS)
SHELLS = (Material.METAL, Material.PAINT, Material.FABRIC)  # materials of robots
GREYS = (0.02, 0.1, 0.3, 0.6)  # linear reflectance of robots


@dataclass(frozen=True)
class Viewpoint:
    """Camera in a room, and the floor before it."""

    room: RoomName
    at_m: F64  # 3, frame: map
    target_m: F64  # 3, point in the middle of the image
    optical_from_map: F64


class Subject(NamedTuple):
    """A person, or a thing like a person."""

    mesh: Mesh
    owner: int
    kind: Kind
    torso_m: F64  # 3, middle of the torso, optical frame


def draw_viewpoint(rng: Rng, room: RoomName) -> Viewpoint:
    """Draw a camera that looks into a room."""
    (left, low), (_, high) = WALKABLE_M[room]
    at_m = np.array(
        [rng.uniform(left, left + 0.8), 0.7 * rng.uniform(low, high), rng.uniform(0.35, 2.5)]
    )
    target_m = np.array([left + 2.2, 0, rng.uniform(0.8, 1.3)]) + rng.normal(0, 0.3, 3)
    pose = camera_pose(at_m, target_m, float(rng.normal(0, 0.1)))
    return Viewpoint(room, at_m, target_m, invert(pose))


def draw_subjects(
    rng: Rng, stage: Stage, people: Sequence[Identity], view: Viewpoint, taken: list[F64]
) -> list[Subject]:
    """Draw some people of a scene, some of them as other things.

    Args:
        rng: Random numbers.
        stage: Bodies and their motions.
        people: People of the scene.
        view: Camera.
        taken: Positions (x, y) of the camera and of earlier things, which grow.
    """
    subjects = list[Subject]()
    count = rng.integers(2, len(people) + 1)
    for k in rng.permutation(len(people))[:count]:
        where = free_position(rng, view, taken)
        if where is None:
            break
        taken.append(where)
        owner, person = len(subjects) + 1, people[k]
        pose = stage.motions[person.body].at(rng.uniform(0, MOTION_S))
        moved = moved_pose(pose, where, rng.uniform(0, 2 * np.pi))
        dressed = stage.bodies[person.body]
        kind, mesh = changed(rng, dressed.mesh(moved, owner, person.paint), where, view)
        joints_m = apply(view.optical_from_map, dressed.body.keypoints_m(moved)[TORSO])
        subjects.append(Subject(mesh, owner, kind, joints_m.mean(axis=0)))
    return subjects


def changed(rng: Rng, mesh: Mesh, where: F64, view: Viewpoint) -> tuple[Kind, Mesh]:
    """Return a person as it is, or in some draws another thing at the same position."""
    draw = rng.random()
    if draw < FLAT_FIGURES:
        slope = rng.uniform(-SLOPE, SLOPE)
        flat_m = flatten(mesh.vertices_m, view.optical_from_map, slope)
        return Kind.FLAT_FIGURE, replace(mesh, vertices_m=flat_m)
    if draw < MANNEQUINS:
        return Kind.MANNEQUIN, mannequin(rng, mesh)
    if draw < ROBOTS:
        parts = robot(rng, int(mesh.owner[0]))
        return Kind.ROBOT, moved(parts, where.tolist(), math.degrees(rng.uniform(0, 6.3)))
    return Kind.PERSON, mesh


def flatten(points_m: F64, optical_from_map: F64, slope: float) -> F64:
    """Return points moved along their rays from the camera towards a plane through their mean."""
    optical_m = apply(optical_from_map, points_m)
    normal = np.array([slope, 0.0, 1.0])
    factor = (normal @ optical_m.mean(axis=0)) / (optical_m @ normal)
    factor += RELIEF * (1 - factor)
    return apply(invert(optical_from_map), optical_m * factor[:, None])


def mannequin(rng: Rng, mesh: Mesh) -> Mesh:
    """Return a body of one colour."""
    grey = float(np.exp(rng.uniform(np.log(0.02), np.log(0.8))))
    colour = np.clip(grey * np.exp(rng.normal(0, 0.08, 3)), 0, 0.85)
    return replace(
        mesh,
        colour=np.tile(colour.astype(np.float32), (len(mesh.colour), 1)),
        material=np.full(len(mesh.faces), int(Material.METAL), np.int32),
        pattern=np.zeros_like(mesh.pattern),
    )


def robot(rng: Rng, owner: int) -> Mesh:
    """Draw a humanoid robot of boxes on legs or a base, 0.9 to 1.75 m high."""
    torso, limbs = draw_shell(rng), draw_shell(rng)
    scale = rng.uniform(0.9, 1.75) / 1.6
    half = rng.uniform(0.16, 0.24) * scale  # half width of the torso [m]
    head = rng.uniform(0.07, 0.16) * scale  # half width of the head [m]
    boxes = [
        (torso, (-0.1 * scale, -half, 0.75 * scale), (0.12 * scale, half, 1.3 * scale)),
        (limbs, (-head, -head, 1.36 * scale), (head, head, 1.6 * scale)),
        (limbs, (-0.03, -0.03, 1.3 * scale), (0.03, 0.03, 1.36 * scale)),
    ]
    for side in (-1, 1):
        y, arm = side * (half + 0.06 * scale), rng.uniform(0.03, 0.06) * scale
        bent = rng.uniform(-0.05, 0.2) * scale  # distance of the forearm before the torso [m]
        low, high = (bent / 2 - arm, y - arm), (bent + arm, y + arm)
        boxes.append((limbs, (-arm, y - arm, 1.0 * scale), (arm, y + arm, 1.28 * scale)))
        boxes.append((torso, (*low, 0.72 * scale), (*high, 1.0 * scale)))
    if rng.random() < 0.5:
        for y in (-0.1 * scale, 0.1 * scale):
            low, high = (-0.08 * scale, y - 0.06 * scale), (0.08 * scale, y + 0.06 * scale)
            boxes.append((limbs, (*low, 0.0), (*high, 0.75 * scale)))
    else:
        post, base = 0.12 * scale, (0.3 * scale, 0.28 * scale)
        boxes.append((limbs, (-post, -post, 0.1), (post, post, 0.75 * scale)))
        boxes.append((limbs, (-base[0], -base[1], 0.0), (*base, 0.2)))
    mesh = join([side for finish, low_m, high_m in boxes for side in box(low_m, high_m, finish)])
    return replace(mesh, owner=np.full(len(mesh.faces), owner, np.int32))


def draw_shell(rng: Rng) -> Finish:
    """Draw the surface of a robot."""
    material = SHELLS[rng.integers(len(SHELLS))]
    grey = GREYS[rng.integers(len(GREYS))]
    red, green, blue = np.clip(grey * np.exp(rng.normal(0, 0.15, 3)), 0, 0.9).tolist()
    return Finish(material, (red, green, blue))


def draw_furniture(rng: Rng, view: Viewpoint, taken: list[F64]) -> list[Mesh]:
    """Draw up to four pieces of furniture or boxes at free positions, one owner each."""
    pieces = list[Mesh]()
    for _ in range(rng.integers(0, 5)):
        where = free_position(rng, view, taken)
        if where is None:
            break
        taken.append(where)
        yaw_deg = math.degrees(rng.uniform(0, 2 * np.pi))
        if rng.random() < 0.5:
            piece = join(list(KINDS.values())[rng.integers(len(KINDS))]())
        else:
            piece = draw_box(rng)
        owner = np.full(len(piece.faces), FURNITURE_OWNER + len(pieces), np.int32)
        pieces.append(replace(moved(piece, where.tolist(), yaw_deg), owner=owner))
    return pieces


def draw_box(rng: Rng) -> Mesh:
    """Draw a box of the size of cabinets, columns and screens, some above the floor."""
    width, depth, height = rng.uniform(0.15, 0.9), rng.uniform(0.15, 0.7), rng.uniform(0.4, 1.9)
    low = 0.0 if rng.random() < 0.8 else rng.uniform(0.3, 1.2)
    material = BOARDS[rng.integers(len(BOARDS))]
    red, green, blue = rng.uniform(0.02, 0.7, 3).tolist()
    corner, top = (depth / 2, width / 2), max(height, low + 0.3)
    finish = Finish(material, (red, green, blue))
    return join(box((-corner[0], -corner[1], low), (*corner, top), finish))


def free_position(rng: Rng, view: Viewpoint, taken: Sequence[F64]) -> F64 | None:
    """Draw a position (x, y) before the camera, apart from others; None if no draw is free."""
    for _ in range(TRIES):
        where = draw_position(rng, view.room, view.at_m, view.target_m)
        if where is not None and is_apart(where, taken, APART_M):
            return where
    return None
