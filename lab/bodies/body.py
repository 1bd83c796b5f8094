"""Dressed body of a person of the cast, in a pose."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from lab.bodies.cast import CastMember, load_cast
from lab.bodies.face import make_eyes, make_glasses, paint_face
from lab.bodies.figure import Figure, load_figure, scaled
from lab.bodies.garments import (
    HemLevels,
    cloth,
    collar_field,
    make_legwear,
    make_shirt,
    make_shoes,
    make_socks,
    measure,
    on_arm,
)
from lab.bodies.hair import make_hair
from lab.bodies.outfits import Outfit, dress_up
from lab.bodies.rig import bend_toes, bend_weights, joint_positions, make_skeleton, map_from_rest
from lab.bodies.skeleton import INDEX, BodyPose, map_from_segments
from lab.bodies.skinning import normals, skin, strongest
from lab.bodies.surface import BodySurface, stack
from lab.drawing.mesh import Material, Mesh
from people4d.errors import ConfigError
from people4d.messages import F32, F64

KEY_SHADE = 101  # key of the random numbers
SHADE = 0.08  # maximum relative change of a garment's brightness by the seed
BODIES = 64  # maximum number of cached bodies
UNDER_M = 0.035  # overlap of skin and clothes at a hem [m]


@lru_cache(maxsize=BODIES)
def load_body(
    name: str, seed: int = 0, outfit: Outfit = "own", number: int = 0, size: float = 1.0
) -> "SkinnedBody":
    """Return a dressed person of the cast; the seed varies the brightness of clothes.

    ConfigError if the cast has no such person.

    Args:
        name: Name in the cast.
        seed: Seed of the scenario.
        outfit: Kind of clothes.
        number: Index of the person in the scenario; random outfits depend on it.
        size: Stature relative to the cast.
    """
    person = load_cast().get(name)
    if person is None:
        raise ConfigError(f"unknown person {name}", f"There are {', '.join(load_cast())}.")
    figure = scaled(load_figure(person.figure), size)
    return SkinnedBody(name, figure, dress(figure, dress_up(person, outfit, seed, number), seed))


class SkinnedBody:
    """A body with skin, hair and clothes that can be posed."""

    def __init__(self, name: str, figure: Figure, surfaces: list[BodySurface]) -> None:
        self.name = name
        vertices, weights, colour, self._faces, self._material, self._pattern = stack(surfaces)
        self._vertices = np.ascontiguousarray(vertices)
        self._colour: F32 = colour.astype(np.float32)
        self.skeleton = make_skeleton(figure, self._vertices, self._faces, self._material)
        ball = self.skeleton.ball
        self._tips = self.skeleton.toe - ball
        self._joints = joint_positions({**figure.joints_m, "ball": ball})
        self._bones, self._shares = strongest(
            bend_weights(weights, self._vertices, figure.bones, ball)
        )
        # Toes carry no keypoints
        self._forms = np.pad(figure.keypoint_forms, ((0, 0), (0, 2), (0, 0)))
        floor = np.array([0.0, 0.0, self.skeleton.heel[0, 2]])
        # Patterns are defined for 1.75 m; they scale with the stature.
        size = 1.75 / self.skeleton.stature_m
        self._texture: F32 = (size * (self._vertices - floor)).astype(np.float32)

    def bones(self, pose: BodyPose) -> F64:
        """Return the transform map_from_rest of each bone, Bx3x4."""
        transforms = map_from_rest(pose, self._joints)
        bend_toes(transforms, self._joints, self._tips)
        return transforms

    def mesh(self, pose: BodyPose, owner: int) -> Mesh:
        """Return skin and clothes in the map; `owner` is the number of the person."""
        vertices = skin(self._vertices, self._bones, self._shares, self.bones(pose))
        return Mesh(
            vertices_m=vertices,
            normals=normals(vertices, self._faces),
            texture_m=self._texture,
            colour=self._colour,
            faces=self._faces,
            material=self._material,
            pattern=self._pattern,
            owner=np.full(len(self._faces), owner, np.int32),
        )

    def keypoints_m(self, pose: BodyPose) -> F64:
        """Return the 17 COCO keypoints in the map, 17x3."""
        return np.asarray(np.einsum("bij,kbj->ki", self.bones(pose), self._forms))

    def chest_yaw(self, pose: BodyPose) -> float:
        """Return the yaw of the chest [rad], frame: map."""
        forward = map_from_segments(pose)[INDEX["chest"]][:, 0]
        return math.atan2(forward[1], forward[0])


def dress(figure: Figure, person: CastMember, seed: int) -> list[BodySurface]:
    """Return all surfaces of a person in the neutral pose; the seed varies their brightness."""
    levels = measure(figure, person)
    clothes = [
        *make_hair(figure, person.hair),
        make_shirt(figure, person.shirt, levels),
        make_legwear(figure, person.legs, levels),
        make_socks(figure, person.shoes, levels),
        *make_shoes(figure, person.shoes, levels),
    ]
    shades = np.random.default_rng([seed, KEY_SHADE]).uniform(-SHADE, SHADE, 16)
    return [
        make_skin(figure, person, levels),
        make_eyes(figure, person),
        *([make_glasses(figure)] if person.glasses else []),
        *(shaded(piece, shade) for piece, shade in zip(clothes, shades, strict=False)),
    ]


def shaded(piece: BodySurface, shade: float) -> BodySurface:
    """Return a piece with a relative change of brightness."""
    return replace(piece, colour=np.clip(piece.colour * (1 + shade), 0, 1))


def make_skin(figure: Figure, person: CastMember, levels: HemLevels) -> BodySurface:
    """Return the bare skin, and an overlap under the clothes."""
    z = figure.vertices_m[:, 2]
    above_collar = UNDER_M - collar_field(figure, levels.collar)
    torso = np.maximum(above_collar, levels.legs + UNDER_M - z)
    bare = np.where(on_arm(figure), levels.sleeve + UNDER_M - z, torso) > 0
    skin = cloth(figure, "body", person.skin, Material.SKIN)
    skin = replace(skin, faces=skin.faces[bare[skin.faces].all(axis=1)])
    return paint_face(skin, figure, person).compact()
