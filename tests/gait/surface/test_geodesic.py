"""Distances along surfaces whose lengths are known."""

import msgspec
import numpy as np
import pytest

from services.gait.surface.body_config import BodyConfig
from services.gait.surface.geodesic import geodesic_m
from services.gait.surface.mesh import Surface, surface_of
from tests.gait.bodies import INFO, PAPER, body_of

LOOSE = msgspec.structs.replace(PAPER, edge_m=0.05)


def strip() -> Surface:
    """A strip of paper folded by 90 degrees at x = 0: z = 2 m + |x|, the fold towards the sensor.

    With x = z k and k = (u - cx) / fx: z = 2 / (1 - |k|).
    """
    k = np.abs(np.arange(270, 371) - INFO.cx) / INFO.fx
    return surface_of(body_of(np.tile(2 / (1 - k), (5, 1)), 270, 238), INFO, LOOSE)


def flat(holes: tuple[slice, slice] | None = None) -> Surface:
    """A plane at 2 m, 41 x 41 pixels of 4 mm."""
    depth = np.full((41, 41), 2.0)
    if holes is not None:
        depth[holes] = 0
    return surface_of(body_of(depth, 300, 220), INFO, LOOSE)


def test_a_folded_strip_is_as_long_as_before_it_was_folded() -> None:
    # Its ends, 50 pixels from the fold: k = 0.1, z = 2.2222 m, x = 0.2222 m. Each half is
    # 0.2222 sqrt(2) long, together 0.6285 m; through the air it is 0.4444 m.
    surface = strip()
    ends = surface.vertices_at([(270, 240), (370, 240)])
    assert geodesic_m(surface, ends[0])[ends[1]] == pytest.approx(0.62854, abs=1e-4)
    air = np.linalg.norm(np.diff(surface.points_m[ends], axis=0))
    assert air == pytest.approx(0.44444, abs=1e-4)


def test_straight_and_across_on_a_plane() -> None:
    # 20 pixels of 4 mm along a row: 0.08 m. 20 across: 0.08 sqrt(2). A knight's way of 20 by 10 has
    # 10 edges across and 10 straight: 0.04 (1 + sqrt(2)), 8 % longer than the straight line.
    surface = flat()
    start, right, across, knight = surface.vertices_at(
        [(310, 230), (330, 230), (330, 250), (330, 240)]
    )
    found = geodesic_m(surface, start)
    assert found[start] == 0
    assert found[right] == pytest.approx(0.08, abs=1e-6)
    assert found[across] == pytest.approx(0.08 * 2**0.5, abs=1e-6)
    assert found[knight] == pytest.approx(0.04 * (1 + 2**0.5), abs=1e-6)


def test_a_way_leads_around_a_slit() -> None:
    # A slit of the columns 20 to 22 and the rows 0 to 30, from one side of it to the other: 30 rows
    # down in column 19, across to (20, 31), straight to (22, 31), across to (23, 30), 30 rows up.
    surface = flat((slice(0, 31), slice(20, 23)))
    a, b = surface.vertices_at([(319, 220), (323, 220)])
    assert geodesic_m(surface, a)[b] == pytest.approx(0.004 * (62 + 2 * 2**0.5), abs=1e-6)


def test_no_way_leads_to_another_piece() -> None:
    surface = flat((slice(None), slice(20, 21)))
    a, b = surface.vertices_at([(310, 230), (330, 230)])
    found = geodesic_m(surface, a)
    assert found[b] == np.inf
    assert np.isfinite(found).sum() == 41 * 20


def test_a_far_part_of_the_body_is_reached_over_its_joint() -> None:
    # A leg 0.25 m behind: one link joins it.
    depth = np.full((41, 41), 2.0)
    depth[:, 21:] = 2.25
    config = BodyConfig(vertices=0, smooth_px=0, continuity_m=0.1)
    surface = surface_of(body_of(depth, 300, 220), INFO, config)
    a, b = surface.vertices_at([(320, 240), (321, 240)])
    link = np.linalg.norm(surface.points_m[a] - surface.points_m[b])
    assert link <= geodesic_m(surface, a)[b] < link + 0.25
    paper = surface_of(body_of(depth, 300, 220), INFO, PAPER)
    assert geodesic_m(paper, a)[b] == np.inf


def test_a_limit_ends_the_search() -> None:
    surface = flat()
    source = surface.vertices_at([(320, 240)])[0]
    free, limited = geodesic_m(surface, source), geodesic_m(surface, source, 0.03)
    assert np.array_equal(limited, np.where(free <= 0.03, free, np.inf))


def test_of_several_sources_the_nearest_counts() -> None:
    surface = flat()
    sources = surface.vertices_at([(305, 225), (330, 250)])
    each = [geodesic_m(surface, source) for source in sources]
    assert geodesic_m(surface, sources) == pytest.approx(np.minimum(*each))


@pytest.mark.parametrize("source", [-1, 10_000, []])
def test_from_nowhere_no_way_leads(source: object) -> None:
    assert (geodesic_m(flat(), np.array(source, np.int64)) == np.inf).all()


def test_a_body_of_nothing_has_no_distances() -> None:
    assert geodesic_m(surface_of(body_of(np.zeros((3, 3))), INFO, PAPER), 0).shape == (0,)
