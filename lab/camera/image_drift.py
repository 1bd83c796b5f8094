"""Drift of automatic exposure and white balance of a low-cost camera."""

import math

from lab.camera.plan import ImagePlan
from lab.depth.noise import NoiseProcess, Persistence
from lab.drawing.renderer import Development

KEY = 0xE4  # key of these random numbers
FROZEN_SHARE = 0.5  # share of the variance that is constant in a recording
DRIFT_S = 3.0  # correlation time of exposure and white balance [s]


class ImageDrift:
    """Development of the image, a function of plan, seed and time only."""

    def __init__(self, plan: ImagePlan, seed: int) -> None:
        persistence = Persistence(frozen_share=FROZEN_SHARE, correlation_s=DRIFT_S)
        self._plan = plan
        self._noise = NoiseProcess((3,), (seed, KEY), persistence)

    def at(self, t_s: float) -> Development:
        """Return the development at a time."""
        plan = self._plan
        stops, red, blue = map(float, self._noise.at(t_s))
        gain = plan.brightness * 2.0 ** (plan.exposure_stops * stops)
        red, blue = math.exp(plan.white_balance * red), math.exp(plan.white_balance * blue)
        return Development((gain * red, gain, gain * blue), plan.grain, plan.blur_px)
