"""Height of the chosen person's torso, compared as a likelihood ratio."""

import math

import msgspec

# Standard deviations of the difference of two heights [m]. One person: 0.02 to 0.04 on rendered
# people who stand and walk, and the mount of the camera; two people: 0.06 each
SAME_M, OTHER_M = 0.04, 0.09
RATIO_MIN = -5.0  # minimum logarithm of the likelihood ratio
SHARE = 0.05  # share of a new height in the mean


class TorsoHeight(msgspec.Struct):
    """Mean height of the torso; a person who sits down gets another one within seconds."""

    mean_m: float | None = None  # None: unknown

    def log_ratio(self, height_m: float) -> float:
        """Return the log likelihood ratio of the chosen person to another one, 0 if unknown."""
        if self.mean_m is None:
            return 0.0
        spread = (1 / SAME_M**2 - 1 / OTHER_M**2) * (height_m - self.mean_m) ** 2 / 2
        return max(math.log(OTHER_M / SAME_M) - spread, RATIO_MIN)

    def learn(self, height_m: float) -> None:
        """Add a height of the chosen person."""
        before_m = height_m if self.mean_m is None else self.mean_m
        self.mean_m = before_m + SHARE * (height_m - before_m)
