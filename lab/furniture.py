"""Furniture and objects of a scenario, and the floor that they occupy."""

import math
from typing import Literal

from common.config import Config

FurnitureKind = Literal["desk", "chair", "partition", "cabinet"]
ObjectKind = Literal["poster", "screen", "mannequin", "robot", "mirror"]
# Long and short side of each kind on the floor [m]
SIZES_M: dict[FurnitureKind | ObjectKind, tuple[float, float]] = {
    "desk": (1.5, 0.7),
    "chair": (0.45, 0.45),
    "partition": (1.2, 0.05),
    "cabinet": (0.8, 0.42),
    "poster": (0.85, 0.05),
    "screen": (0.95, 0.1),
    "mannequin": (0.65, 0.4),
    "robot": (0.65, 0.55),
    "mirror": (0.9, 0.05),
}

FOOTREST_M = 0.06  # height of the footrests of a wheelchair [m]


class Piece(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A piece on the floor."""

    at: tuple[float, float]  # [m] x, y of its middle, frame: map
    yaw_deg: float = 0.0  # [deg] about the vertical, 0: its long side along y of the map

    @property
    def size_m(self) -> tuple[float, float]:
        """Long and short side on the floor."""
        raise NotImplementedError

    def holds(self, x_m: float, y_m: float, margin_m: float = 0.0) -> bool:
        """Check that a position is on the floor under the piece, with a margin."""
        cos, sin = math.cos(math.radians(self.yaw_deg)), math.sin(math.radians(self.yaw_deg))
        dx, dy = x_m - self.at[0], y_m - self.at[1]
        long, deep = self.size_m
        across, along = cos * dx + sin * dy, cos * dy - sin * dx
        return abs(along) <= long / 2 + margin_m and abs(across) <= deep / 2 + margin_m


class FurniturePlan(Piece, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A piece of furniture."""

    # desk: with a screen that faces +x of the piece; partition: 1.3 m high
    kind: FurnitureKind

    @property
    def size_m(self) -> tuple[float, float]:
        """Long and short side on the floor."""
        return SIZES_M[self.kind]


class ObjectPlan(Piece, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An object that looks like a person; its front faces +x of the piece."""

    # poster: a standing figure; screen: a waving figure; mirror: 0.9 x 1.9 m
    kind: ObjectKind
    body: str = "adam"  # figure of a poster, a screen or a mannequin, name in the cast

    @property
    def size_m(self) -> tuple[float, float]:
        """Long and short side on the floor."""
        return SIZES_M[self.kind]


def discs_of(piece: Piece) -> list[tuple[float, float, float]]:
    """Return discs that cover a piece: x, y and radius [m], frame: map."""
    long, deep = piece.size_m
    radius = max(deep / 2, 0.15)
    count = max(1, math.ceil(long / (1.5 * radius)))
    cos, sin = math.cos(math.radians(piece.yaw_deg)), math.sin(math.radians(piece.yaw_deg))
    reach = max(long / 2 - radius, 0.0)
    steps = [0.0] if count == 1 else [reach * (2 * k / (count - 1) - 1) for k in range(count)]
    # The long side is y of the piece.
    return [(piece.at[0] - sin * step, piece.at[1] + cos * step, radius) for step in steps]
