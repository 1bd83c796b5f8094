"""Scenes of walking styles by the second simulator, and the names of styles."""

import math

from benchmarks.lib.gait.other_walkers import Scene, Style, ellipse

FAST_MPS, SLOW_MPS = 1.2, 0.5  # Minimum speed of fast and maximum speed of slow walking [m/s]
CHILD = 0.85  # Maximum height of a child relative to the adult body
TO_AND_FRO = ((2.8, -0.8), (4.7, -0.9))

_RIGHT = ellipse(3.5, -0.6, 0.8, 0.5, at=0.2)
_LEFT = ellipse(3.7, 0.6, 0.8, 0.5, count=-24, at=0.6)
_ELDERLY_RAD = math.radians(20)
# Two people each, fixed before their first run; no constant is chosen on them
STYLE_SCENES = {
    "judge_children": Scene(
        (Style("b", _RIGHT, 0.8, size=(0.74, 0.7)), Style("e", _LEFT, 1.0, size=(0.8, 0.78))),
        fps=15.0,
    ),
    "judge_elderly": Scene(
        (
            Style("d", _LEFT, 0.55, 0.65, lean_rad=_ELDERLY_RAD),
            Style("e", _RIGHT, 0.6, 0.7, 0.0, 0.3),
        ),
        fps=15.0,
        height_m=1.3,
    ),
    "judge_carrying": Scene(
        (Style("e", _RIGHT, 0.8, arms="carry"), Style("b", _LEFT, 0.95, arms="carry")),
        fps=15.0,
        height_m=0.9,
    ),
    "judge_slow": Scene(
        (Style("b", _LEFT, 0.4, 0.7), Style("d", _RIGHT, 0.5, 0.8)),
        fps=15.0,
        height_m=1.5,
    ),
    "judge_limping": Scene(
        (Style("d", _RIGHT, 0.85, limp=0.2), Style("e", _LEFT, 0.8, limp=-0.2)),
        seconds=20.0,
        fps=15.0,
        height_m=1.2,
    ),
}


def style_name(style: Style) -> str:
    """Return the name of the style of a walk."""
    names = {
        "children": style.size[1] < CHILD,
        "skirt": style.skirt,
        "elderly: slow, bent trunk": style.lean_rad > 0,
        "carrying a box": style.arms == "carry",
        "hands in pockets": style.arms == "pockets",
        "limping": style.limp != 0,
        "slow": style.speed_mps <= SLOW_MPS,
        "fast": style.speed_mps > FAST_MPS,
        "turns on the spot, U-turns, stops": style.path == TO_AND_FRO
        or any(len(point) > 2 for point in style.path),
    }
    return next((name for name, is_so in names.items() if is_so), "round or straight")
