"""What a body's mesh tells of its trunk and of the ends of its limbs."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from people4d.messages import F64
from services.gait.points.config import DepthLayerConfig
from services.gait.surface.floor import Floor
from services.gait.surface.mesh import I64, Surface
from services.gait.surface.tips import Tips

UP = np.array([0.0, -1.0, 0.0])  # of a camera that is held level
TRUNK = (0.55, 0.8)  # of the stature, from the loins to the armpits
FOOT_SHARE = 0.14  # of the stature, below which limbs end in feet
HEAD_SHARE = 0.82  # above which they may end in the head
HAND_ALONG_M = 0.3  # nearer to the trunk's middle there are elbows and shoulders, no hands


@dataclass(frozen=True)
class Body3d:
    """One person's surface with what is measured on it; V vertices."""

    surface: Surface
    heights_m: F64  # V, above the floor, or above the lowest vertex where no floor is known
    stature_m: float
    along_m: F64  # V, distance along the mesh from the source; inf where no way leads
    tips: Tips
    kinds: tuple[str, ...]  # of the tips: head, hand, foot or empty
    below_m: F64  # V, distance along the body to the tip that a vertex leads up to

    @property
    def strengths(self) -> F64:
        """How far tips stand out, T: 0 to 1."""
        return np.minimum(self.tips.persistence_m / 0.2, 1.0)


@dataclass(frozen=True)
class LimbEnd:
    """The end of a limb."""

    basin: int  # number of the tip
    kind: str  # head, hand or foot
    position_m: F64  # 3, of its middle
    along_m: float  # distance of the tip along the body
    strength: float  # 0 to 1, how far it stands out


def heights_of(surface: Surface, floor: Floor | None) -> F64:
    """Return how high the vertices are above the floor, V metres."""
    if floor is not None:
        return floor.heights_m(surface.points_m)
    rise = surface.points_m @ UP
    return np.asarray(rise - rise.min()) if len(rise) else rise


def trunk_vertices(heights_m: F64, stature_m: float) -> I64:
    """Return the vertices of the trunk; all if none is between loins and armpits."""
    low, high = (share * stature_m for share in TRUNK)
    found = np.flatnonzero((heights_m > low) & (heights_m < high))
    return found if len(found) else np.arange(len(heights_m))


def kinds_of(vertices: I64, surface: Surface, heights_m: F64, stature_m: float) -> tuple[str, ...]:
    """Tell what limbs end at vertices: the highest near the body's axis is the head."""
    middle = np.median(surface.points_m, axis=0)
    kinds = ["hand"] * len(vertices)
    best = -1
    for k, vertex in enumerate(vertices):
        height = heights_m[vertex]
        aside = abs(surface.points_m[vertex, 0] - middle[0])
        if height < FOOT_SHARE * stature_m:
            kinds[k] = "foot"
        elif height > HEAD_SHARE * stature_m and aside < 0.3:
            kinds[k] = ""
            if best < 0 or height > heights_m[vertices[best]]:
                best = k
    if best >= 0:
        kinds[best] = "head"
    return tuple(kinds)


def body_of(surface: Surface, heights_m: F64, stature_m: float, along_m: F64, tips: Tips) -> Body3d:
    """Put together what is measured on a surface."""
    tops = np.append(along_m[tips.vertices], np.nan)  # the last one serves basin -1
    below = np.nan_to_num(tops[tips.basin] - along_m, nan=np.inf)
    kinds = kinds_of(tips.vertices, surface, heights_m, stature_m)
    return Body3d(surface, heights_m, stature_m, along_m, tips, kinds, below)


def limb_ends(body: Body3d, config: DepthLayerConfig) -> list[LimbEnd]:
    """Return the ends of the body's limbs, those that stand out most first."""
    depths = lengths_m(config)
    ends = []
    for k, kind in enumerate(body.kinds):
        along = float(body.along_m[body.tips.vertices[k]])
        if not kind or (kind == "hand" and along < HAND_ALONG_M):
            continue
        near = (body.tips.basin == k) & (body.below_m <= 2 * depths[kind])
        places = body.surface.points_m[near]
        # Not the mean: more of the nearer side of a limb is seen.
        middle = (places.min(axis=0) + places.max(axis=0)) / 2
        away = np.linalg.norm(places - middle, axis=1)
        position = places[away <= away.min() + config.window_m / 2].mean(axis=0)
        ends.append(LimbEnd(k, kind, position, along, float(body.strengths[k])))
    return sorted(ends, key=lambda end: -end.strength)


def lengths_m(config: DepthLayerConfig) -> Mapping[str, float]:
    """Return how far points are from the end of the limb, by kind."""
    return {"head": config.head_m, "hand": config.hand_m, "foot": config.foot_m}
