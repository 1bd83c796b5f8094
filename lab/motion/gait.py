"""Normative gait cycle, and its dependence on speed and stature."""

import tomllib
from functools import cache
from importlib.resources import files

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from people4d.messages import F64

REFERENCE_MPS = 1.3  # speed of the gait curves [m/s]
REFERENCE_STATURE_M = 1.70  # stature of the walk ratio [m]
LIFT_OFF = 0.62  # phase of lift-off in the gait curves

# Ratio of step length to cadence of adults: constant above 1 m/s, slightly larger below
# [Sekiya 1998]
WALK_RATIO_M_MIN = 0.0064


def step_length_m(speed_mps: npt.ArrayLike, stature_m: float) -> F64:
    """Return the length of one step [m] at speeds [m/s] of any shape.

    From speed = step length x cadence and step length = walk ratio x cadence. People of different
    stature move similarly at the same Froude number v^2 / (g h), so steps grow with h^0.75; [Grieve
    1966] also relate speed to stature.
    """
    speed = np.asarray(speed_mps, np.float64)
    scale = (stature_m / REFERENCE_STATURE_M) ** 0.75
    return np.asarray(np.sqrt(WALK_RATIO_M_MIN * 60.0 * speed) * scale)


def swing_share(speed_mps: npt.ArrayLike) -> F64:
    """Return the share of the swing in the gait cycle.

    0.39 at 1.3 m/s, less in slow walking [Murray 1966].
    """
    return np.asarray(np.clip(0.295 + 0.077 * np.asarray(speed_mps, np.float64), 0.3, 0.41))


@cache
def _splines() -> dict[str, CubicSpline]:
    """Read the curves of assets/gait.toml, periodic with continuous second derivatives."""
    text = files("lab").joinpath("assets/gait.toml").read_text(encoding="utf-8")
    return {
        f"{part}.{name}": CubicSpline(
            np.linspace(0.0, 1.0, len(values) + 1), [*values, values[0]], bc_type="periodic"
        )
        for part, curves in tomllib.loads(text).items()
        for name, values in curves.items()
    }


def gait_curve(name: str, phase: npt.ArrayLike) -> F64:
    """Return a curve of the gait cycle, such as "pelvis.up_m", at phases [cycles]."""
    return np.asarray(_splines()[name](np.asarray(phase, np.float64) % 1.0))
