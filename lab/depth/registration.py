"""Registration of the readings of a depth imager to the colour image."""

import math

import numpy as np

from common.compiled import compiled
from people4d.messages import U16, CameraInfo

SAME_SURFACE = 0.05  # maximum relative difference of depth between neighbours on one surface


def register(reading_mm: U16, offset_m: float, info: CameraInfo) -> U16:
    """Return HxW readings in the view of the colour camera, 0: none.

    The nearer of two readings at one pixel is used. Stretched surfaces have no cracks. Surfaces
    visible to the colour camera only have no reading.

    Args:
        reading_mm: HxW in the view of the depth imager, with the calibration of the colour camera.
        offset_m: Position of the depth imager to the right of the colour camera.
        info: Calibration of both.
    """
    registered = np.zeros_like(reading_mm)
    _register(reading_mm, offset_m * info.fx, registered)
    return registered


@compiled
def _register(reading_mm: U16, focal_offset: float, registered: U16) -> None:
    height, width = reading_mm.shape
    for v in range(height):
        last_mm, last_column = 0.0, 0
        for u in range(width):
            z_mm = float(reading_mm[v, u])
            if z_mm == 0:
                last_mm = 0.0
                continue
            column = math.floor(u + focal_offset * 1000.0 / z_mm + 0.5)
            goes_on = last_mm > 0 and abs(z_mm - last_mm) < SAME_SURFACE * z_mm
            first = last_column + 1 if goes_on and last_column < column else column
            for c in range(max(first, 0), min(column + 1, width)):
                before = registered[v, c]
                if before == 0 or z_mm < before:
                    registered[v, c] = reading_mm[v, u]
            last_mm, last_column = z_mm, column
