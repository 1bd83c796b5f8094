"""Geodesic distances of known length, and their extrema."""

import numpy as np
import pytest

from services.gait.surface import mesh as mesh_module
from services.gait.surface.geodesic import geodesic_extrema, geodesic_m
from services.gait.surface.mesh import BodyMesh, build_mesh
from tests.gait.builders import INFO, body_of, mesh_of

pytestmark = pytest.mark.usefixtures("long_edges")


@pytest.fixture
def long_edges(published: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Edges of up to 5 cm."""
    monkeypatch.setattr(mesh_module, "EDGE_M", 0.05)


def band() -> BodyMesh:
    """A band of paper folded by 90 degrees at x = 0: z = 2 m + |x|, the fold towards the sensor.

    With x = z k and k = (u - cx) / fx: z = 2 / (1 - |k|).
    """
    k = np.abs(np.arange(270, 371) - INFO.cx) / INFO.fx
    return build_mesh(body_of(np.tile(2 / (1 - k), (5, 1)), 270, 238), INFO)


def flat(holes: tuple[slice, slice] | None = None) -> BodyMesh:
    """A plane at 2 m, 41 x 41 pixels of 4 mm."""
    depth = np.full((41, 41), 2.0)
    if holes is not None:
        depth[holes] = 0
    return build_mesh(body_of(depth, 300, 220), INFO)


def test_geodesic_distance_of_a_folded_band_is_its_length() -> None:
    # Its ends, 50 pixels from the fold: k = 0.1, z = 2.2222 m, x = 0.2222 m. Each half is
    # 0.2222 sqrt(2) long, together 0.6285 m; through the air it is 0.4444 m.
    mesh = band()
    ends = mesh.vertices_at([(270, 240), (370, 240)])
    assert geodesic_m(mesh, ends[0])[ends[1]] == pytest.approx(0.62854, abs=1e-4)
    air = np.linalg.norm(np.diff(mesh.points_m[ends], axis=0))
    assert air == pytest.approx(0.44444, abs=1e-4)


def test_geodesic_distance_on_a_plane_straight_and_diagonal() -> None:
    # 20 pixels of 4 mm along a row: 0.08 m. 20 across: 0.08 sqrt(2). A path of 20 by 10 has 10
    # edges across and 10 straight: 0.04 (1 + sqrt(2)), 8 % longer than the straight line.
    mesh = flat()
    start, right, across, oblique = mesh.vertices_at(
        [(310, 230), (330, 230), (330, 250), (330, 240)]
    )
    found = geodesic_m(mesh, start)
    assert found[start] == 0
    assert found[right] == pytest.approx(0.08, abs=1e-6)
    assert found[across] == pytest.approx(0.08 * 2**0.5, abs=1e-6)
    assert found[oblique] == pytest.approx(0.04 * (1 + 2**0.5), abs=1e-6)


def test_geodesic_path_leads_around_a_slit() -> None:
    # A slit of the columns 20 to 22 and the rows 0 to 30, from one side of it to the other: 30 rows
    # down in column 19, across to (20, 31), straight to (22, 31), across to (23, 30), 30 rows up.
    mesh = flat((slice(0, 31), slice(20, 23)))
    a, b = mesh.vertices_at([(319, 220), (323, 220)])
    assert geodesic_m(mesh, a)[b] == pytest.approx(0.004 * (62 + 2 * 2**0.5), abs=1e-6)


def test_unconnected_piece_is_infinitely_far() -> None:
    mesh = flat((slice(None), slice(20, 21)))
    a, b = mesh.vertices_at([(310, 230), (330, 230)])
    found = geodesic_m(mesh, a)
    assert found[b] == np.inf
    assert np.isfinite(found).sum() == 41 * 20


def test_occluded_part_is_reached_over_a_bridge(monkeypatch: pytest.MonkeyPatch) -> None:
    # A leg 0.25 m behind: one link joins it.
    depth = np.full((41, 41), 2.0)
    depth[:, 21:] = 2.25
    published = build_mesh(body_of(depth, 300, 220), INFO)
    monkeypatch.setattr(mesh_module, "JOIN_M", 0.4)
    mesh = build_mesh(body_of(depth, 300, 220), INFO)
    a, b = mesh.vertices_at([(320, 240), (321, 240)])
    link = np.linalg.norm(mesh.points_m[a] - mesh.points_m[b])
    assert link <= geodesic_m(mesh, a)[b] < link + 0.25
    assert geodesic_m(published, a)[b] == np.inf


def test_nearest_of_several_sources_counts() -> None:
    mesh = flat()
    sources = mesh.vertices_at([(305, 225), (330, 250)])
    each = [geodesic_m(mesh, source) for source in sources]
    assert geodesic_m(mesh, sources) == pytest.approx(np.minimum(*each))


@pytest.mark.parametrize("source", [-1, 10_000, []])
def test_invalid_source_reaches_nothing(source: object) -> None:
    assert (geodesic_m(flat(), np.array(source, np.int64)) == np.inf).all()


def test_empty_mesh_has_no_distances() -> None:
    assert geodesic_m(build_mesh(body_of(np.zeros((3, 3))), INFO), 0).shape == (0,)


# A stem 0-1-2 of 0.2 m that forks into 3-4-5, 0.3 m long, and into 6-7, 0.16 m long.
FORK = mesh_of(
    [
        (0.0, 0.0, 2.0),
        (0.0, 0.1, 2.0),
        (0.0, 0.2, 2.0),
        (0.1, 0.2, 2.0),
        (0.2, 0.2, 2.0),
        (0.3, 0.2, 2.0),
        (-0.08, 0.2, 2.0),
        (-0.16, 0.2, 2.0),
        (1.0, 0.0, 2.0),  # not connected
    ],
    [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (2, 6), (6, 7)],
)
DISTANCE_M = geodesic_m(FORK, 0)


def test_each_branch_has_an_extremum_with_its_length_as_persistence() -> None:
    extrema = geodesic_extrema(FORK, DISTANCE_M, 0.06)
    assert extrema.vertices.tolist() == [5, 7]  # the farthest first
    # The longer branch lasts down to the source, 0.2 + 0.3; the shorter one to the fork, 0.16.
    assert extrema.persistence_m == pytest.approx([0.5, 0.16])


def test_basin_of_vertices_is_the_extremum_of_their_branch() -> None:
    extrema = geodesic_extrema(FORK, DISTANCE_M, 0.06)
    assert extrema.basin.tolist() == [0, 0, 0, 0, 0, 0, 1, 1, -1]


def test_branch_below_persistence_belongs_to_the_other() -> None:
    extrema = geodesic_extrema(FORK, DISTANCE_M, 0.17)  # above 0.16
    assert extrema.vertices.tolist() == [5]
    assert extrema.basin.tolist() == [0] * 8 + [-1]


def test_ring_has_one_extremum_opposite_to_the_source() -> None:
    # Both directions meet at one point: one extremum, not two.
    angles = np.arange(8) * np.pi / 4
    ring = mesh_of(
        np.column_stack([np.cos(angles), np.sin(angles), np.full(8, 3.0)]),
        [(k, (k + 1) % 8) for k in range(8)],
    )
    extrema = geodesic_extrema(ring, geodesic_m(ring, 0), 0.1)
    assert extrema.vertices.tolist() == [4]
    assert set(extrema.basin.tolist()) == {0}


def test_unconnected_mesh_has_no_extrema() -> None:
    extrema = geodesic_extrema(FORK, np.full(9, np.inf), 0.06)
    assert len(extrema.vertices) == 0
    assert extrema.basin.tolist() == [-1] * 9
