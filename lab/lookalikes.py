"""Objects that look like people: posters, screens, mannequins, humanoid robots and mirrors.

Each mesh faces +x at the origin of the floor, in metres.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lab.bodies.body import SkinnedBody, load_body
from lab.drawing.furniture import BLACK, STEEL
from lab.drawing.mesh import Material, Mesh, join
from lab.drawing.pieces import moved
from lab.drawing.solids import Finish, box, cylinder, panel, srgb
from lab.furniture import ObjectKind, ObjectPlan
from lab.motion.motion import PersonMotion, simulate
from lab.scenario import Gesture, PersonPlan

KEY = 0x0B7EC  # key of the random numbers
POSTER_M, SCREEN_M, MIRROR_M = (0.85, 2.0), (0.95, 1.7), (0.9, 1.9)  # width and height
LOW_M = 0.1  # height of the lower edge of a picture and of a mirror
FILLED = 0.92  # height of a figure relative to its picture
RELIEF = 0.004  # depth of a printed figure relative to the body
BEFORE_M = 0.004  # distance of a printed figure from its sheet [m]
GLOW = 1.5  # radiance of a white surface on a screen
WAVE_S = 6.0  # interval of the waves on a screen [s]
PLASTICS = ((226, 224, 218), (196, 160, 130), (150, 152, 158), (64, 66, 72))
BARE = (Material.SKIN, Material.HAIR, Material.EYE)


@dataclass(frozen=True)
class Lookalike:
    """An object of a scenario."""

    plan: ObjectPlan
    seed: int  # seed of the scenario
    number: int  # index of the object in the scenario
    duration_s: float  # duration of the scenario

    def mesh(self, t_s: float) -> Mesh:
        """Return the surfaces at a time, frame: map."""
        return moved(KINDS[self.plan.kind](self, t_s), self.plan.at, self.plan.yaw_deg)

    def figure(self, t_s: float) -> Mesh:
        """Return the body of the object at a time, on the floor at the origin."""
        return self._body.mesh(self._motion.at(t_s), owner=0)

    @cached_property
    def plastic(self) -> Finish:
        """Plastic of a random colour."""
        rng = np.random.default_rng([self.seed, KEY, self.number])
        return Finish(Material.METAL, srgb(*PLASTICS[rng.integers(len(PLASTICS))]))

    @cached_property
    def _body(self) -> SkinnedBody:
        return load_body(self.plan.body, self.seed)

    @cached_property
    def _motion(self) -> PersonMotion:
        waves = np.arange(1.0, self.duration_s, WAVE_S).tolist()
        person = PersonPlan(
            body=self.plan.body,
            start=(0.0, 0.0),
            face_deg=0.0,
            gestures=tuple(Gesture(at_s=at_s, move="wave") for at_s in waves),
        )
        (motion,) = simulate([person], [self._body.skeleton], self.duration_s, self.seed)
        return motion


def _poster(thing: Lookalike, t_s: float) -> Mesh:  # noqa: ARG001
    sheet = Finish(Material.FABRIC, thing.plastic.colour)
    printed = flatten(thing.figure(0.0), POSTER_M[1])
    foot = box((-0.2, -0.3, 0.0), (0.2, 0.3, 0.02), STEEL)
    return join([*_board(POSTER_M, sheet), *foot, printed])


def _screen(thing: Lookalike, t_s: float) -> Mesh:
    shown = flatten(thing.figure(t_s), SCREEN_M[1])
    # The picture has its own light, from above and from the front.
    light = 0.5 + 0.5 * np.clip(shown.normals @ (0.8, 0.0, 0.6), 0, 1)
    shown = replace(
        shown,
        colour=(GLOW * shown.colour * light[:, None]).astype(np.float32),
        material=np.full_like(shown.material, Material.LAMP),
    )
    foot = box((-0.25, -0.4, 0.0), (0.25, 0.4, LOW_M), BLACK)
    return join([*_board(SCREEN_M, BLACK), *foot, shown])


def _board(size_m: tuple[float, float], finish: Finish) -> list[Mesh]:
    """Return an upright board whose front is at x = 0."""
    half = size_m[0] / 2
    return box((-0.03, -half, LOW_M), (0.0, half, LOW_M + size_m[1]), finish)


def flatten(body: Mesh, height_m: float) -> Mesh:
    """Return a body at the origin as a flat picture of a height on the board at x = 0."""
    stature_m = float(body.vertices_m[:, 2].max())
    size = FILLED * height_m / stature_m
    x, y, z = body.vertices_m.T
    flat = [BEFORE_M + RELIEF * (x - x.min()), size * y, LOW_M + size * z + 0.02]
    return replace(body, vertices_m=np.column_stack(flat))


def _mannequin(thing: Lookalike, t_s: float) -> Mesh:  # noqa: ARG001
    body = thing.figure(0.0)
    bare = np.isin(body.material, BARE)
    colour = body.colour.copy()
    colour[np.unique(body.faces[bare])] = thing.plastic.colour
    material = np.where(bare, np.int32(thing.plastic.material), body.material)
    stand = cylinder((0.0, 0.0, 0.0), 0.2, 0.008, STEEL)
    return join([replace(body, colour=colour, material=material), *stand])


def _robot(thing: Lookalike, t_s: float) -> Mesh:  # noqa: ARG001
    """Return a humanoid robot of 1.2 to 1.7 m, on legs or on a base with wheels."""
    rng = np.random.default_rng([thing.seed, KEY, thing.number, 1])
    size, joints = rng.uniform(1.2, 1.7) / 1.6, BLACK
    parts = box((-0.1, -0.19, 0.8), (0.12, 0.19, 1.3), thing.plastic)
    parts += cylinder((0.0, 0.0, 1.3), 0.05, 0.07, joints)
    parts += cylinder((0.02, 0.0, 1.37), 0.1, 0.23, thing.plastic)
    parts += box((0.1, -0.07, 1.46), (0.125, 0.07, 1.54), joints)  # visor
    for side in (-1.0, 1.0):
        y = side * 0.25
        parts += cylinder((0.0, y, 1.2), 0.06, 0.1, joints)
        parts += cylinder((0.0, y, 0.98), 0.045, 0.22, thing.plastic)
        parts += cylinder((0.03, y, 0.7), 0.038, 0.3, thing.plastic)
    if rng.random() < 0.5:
        parts += box((-0.09, -0.17, 0.7), (0.1, 0.17, 0.8), joints)
        for y in (-0.1, 0.1):
            parts += cylinder((0.0, y, 0.4), 0.07, 0.3, thing.plastic)
            parts += cylinder((0.0, y, 0.05), 0.055, 0.35, thing.plastic)
            parts += box((-0.08, y - 0.05, 0.0), (0.16, y + 0.05, 0.06), joints)
    else:
        parts += cylinder((0.0, 0.0, 0.2), 0.11, 0.6, joints)
        parts += cylinder((0.0, 0.0, 0.03), 0.27, 0.17, thing.plastic)
    robot = join(parts)
    return replace(robot, vertices_m=robot.vertices_m * size)


def _mirror(thing: Lookalike, t_s: float) -> Mesh:  # noqa: ARG001
    half, top_m = MIRROR_M[0] / 2, LOW_M + MIRROR_M[1]
    glass = panel(
        (0.001, -half, LOW_M),
        (0.0, 2 * half, 0.0),
        (0.0, 0.0, top_m - LOW_M),
        Finish(Material.MIRROR, srgb(120, 124, 128)),
    )
    foot = box((-0.25, -half, 0.0), (0.15, half, 0.03), STEEL)
    return join([glass, *_board(MIRROR_M, STEEL), *foot])


KINDS: dict[ObjectKind, Callable[[Lookalike, float], Mesh]] = {
    "poster": _poster,
    "screen": _screen,
    "mannequin": _mannequin,
    "robot": _robot,
    "mirror": _mirror,
}
