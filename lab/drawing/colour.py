"""From radiance to the image: lens, tone curve and noise of a sensor."""

import math

import numpy as np
import numpy.typing as npt

from common.compiled import compiled
from lab.drawing.raster import in_bands
from people4d.messages import F32, U8

KEY_GRAIN, KEY_SHIFT = 311, 312  # keys of the random numbers
GRAIN_PX = 1024  # side of the noise pattern of all frames [px]
READ_NOISE = 0.005  # standard deviation of read noise, relative to the range of the image
PHOTON_NOISE = 0.008  # additional noise in black, since gamma expands dark values
VIGNETTE = 0.22  # relative loss of light in the corners
SATURATION = 0.86  # saturation of colours
STRAY = 0.002  # stray light in the lens, relative to white
WHITE_POINT = 1.8  # radiance of white
CONTRAST = 1.22  # exponent of the tone curve
BLUR = 0.06  # share of a pixel's light on each of its four neighbours
TONES = 4096  # number of samples of the tone curve
TOP = 8.0  # maximum radiance of the tone curve


def tone_curve() -> F32:
    """Return the brightness (0 to 1, gamma applied) of TONES radiances from 0 to TOP.

    The middle is linear, with a soft shoulder for bright windows and stray light above black.
    """
    # The roots of the radiances are evenly spaced, since the eye resolves dark tones better.
    x = TOP * np.linspace(0, 1, TONES) ** 2
    response = STRAY + (1 - STRAY) * x * (1 + x / WHITE_POINT**2) / (1 + x)
    response = np.clip(response, 0.0, 1.0) ** CONTRAST
    low = response <= 0.0031308
    curve = np.where(low, 12.92 * response, 1.055 * response ** (1 / 2.4) - 0.055)
    return curve.astype(np.float32)


def grain(seed: int) -> F32:
    """Return the noise of a sensor: neighbours are weakly correlated, as after debayering."""
    white = np.random.default_rng([seed, KEY_GRAIN]).standard_normal((GRAIN_PX, GRAIN_PX))
    soft = white + 0.45 * np.roll(white, 1, 0) + 0.45 * np.roll(white, 1, 1)
    return (soft / math.sqrt(1 + 2 * 0.45**2)).astype(np.float32)


def develop(
    radiance: F32, exposure: float, pattern: F32, key: tuple[int, int], threads: int = 1
) -> U8:
    """Return the image of a radiance, HxWx3 red first; the key, seed and frame, selects noise."""
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
