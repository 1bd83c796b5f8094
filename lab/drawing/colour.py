"""From radiance to the image: lens, tone curve and noise of a sensor."""

import math

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from lab.drawing.raster import in_bands
from people4d.messages import F32, U8

KEY_GRAIN, KEY_SHIFT = 311, 312  # of the random numbers
GRAIN_PX = 1024  # of the pattern that all frames' noise is cut from
READ_NOISE = 0.005  # of the sensor, in parts of the image's range
PHOTON_NOISE = 0.008  # more where it is dark, since gamma spreads what is dark
VIGNETTE = 0.22  # loss of light in the corners
SATURATION = 0.86
STRAY = 0.002  # light that strays in the lens, in parts of white
WHITE_POINT = 1.8  # radiance that is just white
CONTRAST = 1.22
BLUR = 0.06  # share of a pixel's light that falls on each of its four neighbours
TONES = 4096  # of the tone curve
TOP = 8.0  # brightest radiance of the tone curve


def tone_curve() -> F32:
    """Return the image's brightness (0 to 1, gamma applied) for TONES radiances from 0 to TOP.

    A straight middle with a soft shoulder, so that windows are bright but not burnt out at once,
    and a little light that strays in the lens, so that black is not quite black.
    """
    # Radiances are spaced by their root, since the eye sees differences of what is dark.
    x = TOP * np.linspace(0, 1, TONES) ** 2
    response = STRAY + (1 - STRAY) * x * (1 + x / WHITE_POINT**2) / (1 + x)
    response = np.clip(response, 0.0, 1.0) ** CONTRAST
    low = response <= 0.0031308
    curve = np.where(low, 12.92 * response, 1.055 * response ** (1 / 2.4) - 0.055)
    return curve.astype(np.float32)


def grain(seed: int) -> F32:
    """Return the noise of a sensor: neighbours are a little alike, as after debayering."""
    white = np.random.default_rng([seed, KEY_GRAIN]).standard_normal((GRAIN_PX, GRAIN_PX))
    soft = white + 0.45 * np.roll(white, 1, 0) + 0.45 * np.roll(white, 1, 1)
    return (soft / math.sqrt(1 + 2 * 0.45**2)).astype(np.float32)


def develop(
    radiance: F32, exposure: float, pattern: F32, key: tuple[int, int], threads: int = 1
) -> U8:
    """Return the image of a linear radiance, HxWx3 red first.

    The noise is cut from a pattern, see `grain`, by the key: seed and frame.
    """
    shifts = np.random.default_rng([*key, KEY_SHIFT]).integers(0, GRAIN_PX, (3, 2))
    image = np.empty(radiance.shape, np.uint8)
    curve = tone_curve()
    in_bands(
        lambda first, last: _develop(
            radiance, exposure, curve, pattern, shifts, first, last, image
        ),
        radiance.shape[0],
        threads,
    )
    return image


@compiled
def _develop(
    radiance: F32,
    exposure: float,
    curve: F32,
    pattern: F32,
    shifts: npt.NDArray[np.int64],
    first: int,
    last: int,
    image: U8,
) -> None:
    height, width = radiance.shape[:2]
    scale = (TONES - 1) / math.sqrt(TOP)
    corner = 1.0 / (0.25 * (height * height + width * width))
    pixel = np.empty(3)
    for row in range(first, last):
        above, below = max(row - 1, 0), min(row + 1, height - 1)
        for column in range(width):
            left, right = max(column - 1, 0), min(column + 1, width - 1)
            dv, du = row - 0.5 * height, column - 0.5 * width
            gain = exposure * (1.0 - VIGNETTE * (dv * dv + du * du) * corner)
            for k in range(3):
                cross = radiance[above, column, k] + radiance[below, column, k]
                cross += radiance[row, left, k] + radiance[row, right, k]
                own = radiance[row, column, k]
                pixel[k] = gain * (own + BLUR * (cross - 4.0 * own))
            grey = 0.3 * pixel[0] + 0.6 * pixel[1] + 0.1 * pixel[2]
            for k in range(3):
                value = max(grey + SATURATION * (pixel[k] - grey), 0.0)
                at = min(math.sqrt(value) * scale, TONES - 1.001)
                index = int(at)
                tone = curve[index] + (at - index) * (curve[index + 1] - curve[index])
                noise = pattern[(row + shifts[k, 0]) % GRAIN_PX, (column + shifts[k, 1]) % GRAIN_PX]
                tone += noise * (READ_NOISE + PHOTON_NOISE * (1.0 - tone))
                image[row, column, k] = np.uint8(min(max(tone, 0.0), 1.0) * 255.0 + 0.5)
