"""Colours of data files: sRGB as #rrggbb to linear reflectance."""

import numpy as np

from people4d.messages import F64


def linear(colour: str) -> F64:
    """Return red, green, blue, 0 to 1, of #rrggbb (IEC 61966-2-1)."""
    encoded = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    decoded: F64 = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return decoded
