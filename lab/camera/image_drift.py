"""Exposure and white balance of a plain camera, which drift as automatic ones do."""

import math

from lab.camera.plan import ImagePlan
from lab.depth.noise import NoiseProcess, Persistence
from lab.drawing.renderer import Development

KEY = 0xE4  # sets these random numbers apart from others of the same seed
HALF = 0.5  # of the variance of each that does not change over the recording


class ImageDrift:
    """Settings of the image at any time: a function of plan, seed and time only."""

    def __init__(self, plan: ImagePlan, seed: int) -> None:
        persistence = Persistence(frozen_share=HALF, correlation_s=plan.drift_s)
        self._plan = plan
        self._noise = NoiseProcess((3,), (seed, KEY), persistence)

    def at(self, t_s: float) -> Development:
        """Return the settings at a time."""
        plan = self._plan
        stops, red, blue = map(float, self._noise.at(t_s))
        gain = plan.brightness * 2.0 ** (plan.exposure_stops * stops)
        red, blue = math.exp(plan.white_balance * red), math.exp(plan.white_balance * blue)
        return Development((gain * red, gain, gain * blue), plan.grain, plan.blur_px)
