"""Flat figures look like bodies from the camera, and are almost planes; numbers of views."""

import numpy as np
import pytest

from benchmarks.lib.postures.rooms import KINDS, RELIEF, flatten, view_seeds


def test_flat_figure_stays_on_the_rays_of_the_camera_and_loses_its_depth() -> None:
    """A body 3 m ahead and 0.4 m deep becomes 2 % as deep, 8 mm."""
    rng = np.random.default_rng(1)
    points_m = np.array([0.2, 0.1, 3.0]) + rng.uniform(-1, 1, (200, 3)) * (0.3, 0.9, 0.2)
    flat_m = flatten(points_m, np.eye(4), slope=0.0)
    assert flat_m[:, :2] / flat_m[:, 2:] == pytest.approx(points_m[:, :2] / points_m[:, 2:])
    depth_m = points_m[:, 2] - points_m[:, 2].mean()
    assert flat_m[:, 2] - flat_m[:, 2].mean() == pytest.approx(RELIEF * depth_m, abs=1e-9)


def test_sloping_flat_figure_is_farther_at_one_side() -> None:
    """The plane 0.5 x + z = 3 is at z = 3 - 0.5 x."""
    sides_m = np.array([[-0.3, 0.0, 3.0], [0.3, 0.0, 3.0]])
    left_m, right_m = flatten(sides_m, np.eye(4), slope=0.5)
    assert left_m[2] - right_m[2] == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize(("views", "empty", "figures"), [(60, 60, 6), (10, 10, 1), (5, 5, 1)])
def test_a_tenth_of_the_views_has_figures_and_at_least_one(
    views: int, empty: int, figures: int
) -> None:
    assert view_seeds(KINDS["without furniture"], views) == range(empty)
    assert view_seeds(KINDS["with two mannequins"], views) == range(figures)
