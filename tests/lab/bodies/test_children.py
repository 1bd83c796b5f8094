"""Children: their stature and proportions, and that only some scenes draw them."""

import numpy as np
import pytest

from lab.bodies.body import load_body
from lab.bodies.cast import cast_names, child_names, load_cast
from lab.bodies.figure import load_figure


@pytest.mark.parametrize(
    ("name", "years", "stature_m"), [("kim", 3, 0.96), ("leo", 5, 1.10), ("mia", 8, 1.27)]
)
def test_stature_is_the_median_of_the_age(name: str, years: int, stature_m: float) -> None:
    bare_m = np.ptp(load_figure(name).vertices_m[np.unique(load_figure(name).faces["body"])][:, 2])
    assert load_cast()[name].age_years == years
    # The feet of the asset are hidden by shoes and left out.
    assert stature_m - 0.11 < bare_m < stature_m
    assert load_body(name).skeleton.stature_m == pytest.approx(stature_m + 0.03, abs=0.025)


def test_heads_of_children_are_large_and_legs_short() -> None:
    """The ears are 0.08 statures apart on an adult, and 0.12 on a child of 3 years."""
    heads, legs = [], []
    for name in ("kim", "leo", "mia", "adam"):
        skeleton = load_body(name).skeleton
        points_m = load_figure(name).keypoint_forms[:, :, :3].sum(axis=1)
        heads.append((points_m[3, 1] - points_m[4, 1]) / skeleton.stature_m)
        legs.append(-skeleton.heel[0, 2] / skeleton.stature_m)
    assert heads == sorted(heads, reverse=True)
    assert legs[0] < legs[-1]


def test_random_scenes_draw_no_children_unless_asked() -> None:
    assert child_names() == ["kim", "leo", "mia"]
    assert len(cast_names()) == 12
    assert not set(cast_names()) & set(child_names())
