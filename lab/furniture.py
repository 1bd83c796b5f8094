"""Furniture of a scenario, and the floor that it occupies."""

import math
from typing import Literal

from common.config import Config

FurnitureKind = Literal["desk", "chair", "partition", "cabinet"]
# Long and short side of each kind on the floor [m]
SIZES_M: dict[FurnitureKind, tuple[float, float]] = {
    "desk": (1.5, 0.7),
    "chair": (0.45, 0.45),
    "partition": (1.2, 0.05),
    "cabinet": (0.8, 0.42),
}
FOOTREST_M = 0.06  # height of the footrests of a wheelchair [m]


class FurniturePlan(Config, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A piece of furniture."""

    # desk: with a screen that faces +x of the piece; partition: 1.3 m high
    kind: FurnitureKind
    at: tuple[float, float]  # [m] x, y of its middle, frame: map
    yaw_deg: float = 0.0  # [deg] about the vertical, 0: its long side along y of the map

    def holds(self, x_m: float, y_m: float, margin_m: float = 0.0) -> bool:
        """Check that a position is on the floor under the piece, with a margin."""
        cos, sin = math.cos(math.radians(self.yaw_deg)), math.sin(math.radians(self.yaw_deg))
        dx, dy = x_m - self.at[0], y_m - self.at[1]
        long, deep = SIZES_M[self.kind]
        across, along = cos * dx + sin * dy, cos * dy - sin * dx
        return abs(along) <= long / 2 + margin_m and abs(across) <= deep / 2 + margin_m


def discs_of(piece: FurniturePlan) -> list[tuple[float, float, float]]:
    """Return discs that cover a piece of furniture: x, y and radius [m], frame: map."""
    long, deep = SIZES_M[piece.kind]
    radius = max(deep / 2, 0.15)
    count = max(1, math.ceil(long / (1.5 * radius)))
    cos, sin = math.cos(math.radians(piece.yaw_deg)), math.sin(math.radians(piece.yaw_deg))
    reach = max(long / 2 - radius, 0.0)
    steps = [0.0] if count == 1 else [reach * (2 * k / (count - 1) - 1) for k in range(count)]
    # The long side is y of the piece.
    return [(piece.at[0] - sin * step, piece.at[1] + cos * step, radius) for step in steps]
