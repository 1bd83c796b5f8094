"""Lens distortion by its names in drivers, SDKs and calibration files."""

import re

import numpy as np
import numpy.typing as npt

from people4d.errors import SourceError

# Pinhole models with OpenCV's coefficients k1 k2 p1 p2 k3 k4 k5 k6. "brown_conrady"
# models come from librealsense; realsense2_camera also publishes them as plumb_bob.
PINHOLES = (
    *("", "none", "plumb_bob", "rational_polynomial"),
    *("brown_conrady", "inverse_brown_conrady", "modified_brown_conrady"),
)
FISHEYES = ("equidistant", "fisheye")  # models with OpenCV's coefficients k1 k2 k3 k4
LENGTHS = (0, 5, 8)  # numbers of coefficients of none, plumb_bob and rational_polynomial


def read_distortion(model: str, coefficients: npt.ArrayLike) -> tuple[float, ...]:
    """Return 0, 5 or 8 coefficients, as their model requires, and 4 of a fisheye lens.

    Trailing zeros are ignored. SourceError if the model is unknown, or has too many coefficients.
    """
    numbers = np.trim_zeros(np.ravel(np.asarray(coefficients, np.float64)), "b").tolist()
    name = re.sub(r"\W+", "_", model.lower())
    if is_fisheye(model) and len(numbers) <= 4:
        return tuple(numbers + [0.0] * (4 - len(numbers)))
    known = name in PINHOLES and not (name == "none" and numbers)
    length = next((length for length in LENGTHS if len(numbers) <= length), None)
    if not known or length is None:
        raise SourceError(
            "CameraInfo: expected distortion plumb_bob, rational_polynomial or equidistant, got "
            f"{len(numbers)} numbers for {model!r:.40}",
            "Play rectified images, or give a calibration with options.calibration.",
        )
    return tuple(numbers + [0.0] * (length - len(numbers)))


def is_fisheye(model: str) -> bool:
    """Check for the name of an equidistant lens."""
    return model.strip().lower() in FISHEYES
