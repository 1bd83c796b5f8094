"""Objects with corners at measured positions in the map: AprilTags and chessboards."""

from typing import Annotated

import cv2
import msgspec
import numpy as np
from msgspec import Meta

from people4d.messages import F32, F64

Coordinate = Annotated[float, Meta(ge=-1e4, le=1e4)]
Corners = Annotated[int, Meta(ge=3, le=50)]


class Mounted(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An object on a wall, or flat on the floor or a table."""

    position_m: tuple[Coordinate, Coordinate, Coordinate]  # [m] centre, frame: map
    # [deg] from x of the map towards y: direction that it faces; of its upper edge if it is flat
    facing_deg: Annotated[float, Meta(ge=-360, le=360)]
    flat: bool = False

    def in_map(self, points_m: F64) -> F64:
        """Return points (Nx2, right and up from its centre) in the map, Nx3."""
        angle = np.radians(self.facing_deg)
        direction, vertical = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([0, 0, 1.0])
        normal, up = (vertical, direction) if self.flat else (direction, vertical)
        right = np.cross(up, normal)
        return np.asarray(np.array(self.position_m) + points_m @ np.array([right, up]))


class Tag(Mounted, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An AprilTag."""

    size_m: Annotated[float, Meta(ge=0.01, le=5)]  # [m] side of its black square

    @property
    def corners_m(self) -> F64:
        """Corners (4x3) in the map: upper left, upper right, lower right, lower left."""
        signs = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
        return self.in_map(signs * self.size_m / 2)


class Board(Mounted, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A chessboard; among its inner corners the upper left cell is black."""

    columns: Corners  # inner corners in a row
    rows: Corners  # inner corners in a column
    square_m: Annotated[float, Meta(ge=0.005, le=1)]  # [m] side of a cell

    def __post_init__(self) -> None:
        """Check that the board differs from itself turned round."""
        if (self.columns + self.rows) % 2 == 0:
            raise ValueError(
                f"columns, rows: expected one odd and one even, got {self.columns} and {self.rows}"
            )

    @property
    def corners_m(self) -> F64:
        """Inner corners (Nx3) in the map, row by row from the upper left."""
        rows, columns = np.mgrid[: self.rows, : self.columns]
        right = columns - (self.columns - 1) / 2
        up = (self.rows - 1) / 2 - rows
        return self.in_map(np.column_stack([right.ravel(), up.ravel()]) * self.square_m)

    def find(self, grey: cv2.typing.MatLike) -> F32 | None:
        """Return the pixels (Nx2) of the inner corners in an image (HxW); None: not found."""
        found, corners = cv2.findChessboardCornersSB(grey, (self.columns, self.rows))
        if not found:
            return None
        grid = np.asarray(corners, np.float32).reshape(self.rows, self.columns, 2)
        # The detector may begin at either end: the upper left cell is black, the lower right white.
        first, last = (_cell_mean(grey, grid, at) for at in (0, -2))
        ordered = grid if first < last else grid[::-1, ::-1]
        return ordered.reshape(-1, 2)


def _cell_mean(grey: cv2.typing.MatLike, grid: F32, at: int) -> float:
    """Return the brightness in the middle of the first (0) or the last (-2) cell of a board."""
    rows = grid[at : at + 2 or None, at : at + 2 or None]
    patch = cv2.getRectSubPix(grey, (3, 3), tuple(rows.reshape(-1, 2).mean(axis=0).tolist()))
    return float(patch.mean())
