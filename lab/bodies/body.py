"""A person of the cast: dressed, and posed as motion asks."""

import math
from functools import cache

import numpy as np

from lab.bodies.bones import bend_toes, joint_positions, map_from_rest
from lab.bodies.cast import cast_names, load_cast
from lab.bodies.dressing import dress
from lab.bodies.figure import Figure, load_figure
from lab.bodies.skinning import normals, skin, strongest
from lab.bodies.soles import bend_weights, make_skeleton
from lab.bodies.surface import Surface, stack
from lab.drawing.mesh import Mesh
from lab.posture import INDEX, Posture, map_from_segments
from people4d.errors import ConfigError
from people4d.messages import F32, F64

__all__ = ["Body", "cast_names", "load_body"]


@cache
def load_body(name: str, seed: int = 0) -> "Body":
    """Return a dressed person of the cast.

    Args:
        name: See `cast_names`.
        seed: Of the small differences, as in the shade of colours.

    Raises:
        ConfigError: There is none of that name.
    """
    person = load_cast().get(name)
    if person is None:
        raise ConfigError(f"there is no person {name}", f"There are {', '.join(cast_names())}.")
    figure = load_figure(person.figure)
    return Body(name, figure, dress(figure, person, seed))


class Body:
    """A person who can be posed.

    Args:
        name: In the cast.
        figure: The baked body.
        surfaces: Skin, hair and clothes in the neutral posture.
    """

    def __init__(self, name: str, figure: Figure, surfaces: list[Surface]) -> None:
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
        self._forms = np.pad(figure.keypoint_forms, ((0, 0), (0, 2), (0, 0)))  # none on the toes
        floor = np.array([0.0, 0.0, self.skeleton.heel[0, 2]])
        # Patterns are drawn for 1.75 m; smaller people wear smaller sizes.
        size = 1.75 / self.skeleton.stature_m
        self._texture: F32 = (size * (self._vertices - floor)).astype(np.float32)

    def bones(self, posture: Posture) -> F64:
        """Return the transform map_from_rest of each bone, Bx3x4."""
        transforms = map_from_rest(posture, self._joints)
        bend_toes(transforms, self._joints, self._tips)
        return transforms

    def mesh(self, posture: Posture, owner: int) -> Mesh:
        """Return skin and clothes in the map.

        Args:
            posture: How and where the person is.
            owner: Number under which its triangles are known.
        """
        vertices = skin(self._vertices, self._bones, self._shares, self.bones(posture))
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

    def keypoints_m(self, posture: Posture) -> F64:
        """Return the 17 COCO keypoints in the map, 17x3."""
        keypoints: F64 = np.einsum("bij,kbj->ki", self.bones(posture), self._forms)
        return keypoints

    def chest_yaw(self, posture: Posture) -> float:
        """Return which way the chest faces, in rad, frame: map."""
        forward = map_from_segments(posture)[INDEX["chest"]][:, 0]
        return math.atan2(forward[1], forward[0])
