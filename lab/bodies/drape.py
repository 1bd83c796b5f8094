"""Cloth that hangs from what stands out above it, instead of clinging to the body."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import map_coordinates

from lab.bodies.surface import Surface
from people4d.messages import F64

SECTORS = 36
ROW_M = 0.015
FALL = 0.22  # by how much cloth comes back to the body per length that it hangs


def hung(piece: Surface, axis_x_m: float, free: F64) -> Surface:
    """Return cloth around the trunk with its hollows bridged.

    Args:
        piece: The cloth.
        axis_x_m: Place of the trunk's upright axis.
        free: V, 0 where the cloth stays as it is, 1 where it hangs freely.
    """
    x, y, z = piece.vertices_m.T
    around = np.arctan2(y, x - axis_x_m) / (2 * np.pi) * SECTORS % SECTORS
    radius = np.hypot(x - axis_x_m, y)
    top = z[free > 0].max()
    row = (top - z) / ROW_M
    outline = hanging_outline(around[free > 0], row[free > 0], radius[free > 0])
    wanted = map_coordinates(outline, [row, around], order=1, mode="grid-wrap")
    grown = 1 + free * np.maximum(wanted - radius, 0.0) / np.maximum(radius, 1e-3)
    places = np.stack([axis_x_m + (x - axis_x_m) * grown, y * grown, z], axis=1)
    return replace(piece, vertices_m=places)


def hanging_outline(around: F64, row: F64, radius: F64) -> F64:
    """Return the radius of hanging cloth over rows, from the top, and sectors.

    Args:
        around: V places in sectors, 0 to SECTORS.
        row: V places in rows.
        radius: V distances of the close-fitting cloth from the axis in metres.
    """
    rows = int(row.max()) + 2
    outline = np.zeros((rows, SECTORS))
    places = (np.clip(np.rint(row), 0, rows - 1).astype(int), np.rint(around).astype(int) % SECTORS)
    np.maximum.at(outline, places, radius)
    # Cloth is taut between its neighbours on both sides.
    beside = (np.roll(outline, 1, axis=1) + np.roll(outline, -1, axis=1)) / 2
    outline = np.maximum(outline, beside)
    for below in range(1, rows):
        outline[below] = np.maximum(outline[below], outline[below - 1] - FALL * ROW_M)
    return outline
