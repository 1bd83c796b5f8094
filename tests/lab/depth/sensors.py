"""A depth sensor without errors, and the correlation of its noise in closed form."""

import math

from lab.depth.config import DepthSensorModel
from lab.depth.noise import Persistence

# Reads whole millimetres and makes no other error.
EXACT = DepthSensorModel(
    noise_px=0,
    step_px=0,
    ragged_px=0,
    shadow=False,
    left_band=False,
    edge_holes=0,
    holes=0,
    min_depth_m=0,
    max_depth_m=65.5,
)


def correlation(persistence: Persistence, lag_s: float) -> float:
    """Return the correlation of two values a time apart, the mean over the time of the first.

    With d = pi/2 lag/correlation_s, both lie between the same knots for 1 - lag/correlation_s
    of the time: cos d. Else the second is one knot farther: the mean of sin(a) sin(a + d).
    """
    lag = abs(lag_s) / persistence.correlation_s
    d = lag * math.pi / 2
    if lag < 1:
        running = (1 - lag) * math.cos(d) + (d * math.cos(d) + math.sin(d)) / math.pi
    elif lag < 2:
        e = math.pi - d
        running = (math.sin(e) - e * math.cos(e)) / math.pi
    else:
        running = 0.0
    return persistence.frozen_share + (1 - persistence.frozen_share) * running
