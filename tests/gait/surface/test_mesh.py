"""Meshes and normals of known shapes."""

import numpy as np
import pytest

from people4d.messages import F64
from services.gait.surface import mesh as mesh_module
from services.gait.surface.mesh import BodyMesh, build_mesh
from services.gait.surface.segmentation import Mask
from tests.gait.builders import INFO, body_of

V, U = np.mgrid[200:280, 280:360].astype(np.float64)
RAYS = np.stack([(U - INFO.cx) / INFO.fx, (V - INFO.cy) / INFO.fy, np.ones_like(U)], axis=-1)


def plane(normal: tuple[float, float, float], away_m: float = 2.0) -> F64:
    """Depth of the plane through (0, 0, away)."""
    return np.asarray(away_m * normal[2] / (RAYS @ np.array(normal)))


def sphere(away_m: float = 1.0, radius_m: float = 0.2) -> F64:
    """Depth of a sphere's near side: the nearer t at which |t ray - (0, 0, away)| = radius."""
    a = np.einsum("ijk,ijk->ij", RAYS, RAYS)
    inside = away_m**2 - a * (away_m**2 - radius_m**2)
    return np.where(inside > 0, (away_m - np.sqrt(np.maximum(inside, 0))) / a, 0.0)


def inner(mesh: BodyMesh) -> Mask:
    """Flag the vertices with all eight neighbours."""
    return np.asarray(np.diff(mesh.indptr) == 8)


@pytest.mark.usefixtures("published")
def test_the_15_mm_rule_by_hand() -> None:
    # At 2 m a pixel is 4 mm wide. 14 mm farther: sqrt(4^2 + 14^2) = 14.6 mm, one edge; 15 mm
    # farther: 15.5 mm, none. The next is 4 mm away.
    for step_m, edges in [(0.014, 2), (0.015, 1)]:
        depth = [[2.0, 2.0 + step_m, 2.0 + step_m]]
        mesh = build_mesh(body_of(depth, 319, 240), INFO)
        assert len(mesh.indices) == 2 * edges
        if edges == 2:
            assert mesh.lengths_m[0] == pytest.approx(np.hypot(0.004, 0.014), abs=3e-5)


@pytest.mark.usefixtures("published")
def test_vertices_have_eight_neighbours() -> None:
    # 3 x 3: 8 in the middle, 5 on each side, 3 at each corner: 8 + 20 + 12 = 40.
    mesh = build_mesh(body_of(np.full((3, 3), 2.0)), INFO)
    assert np.diff(mesh.indptr).tolist() == [3, 5, 3, 5, 8, 5, 3, 5, 3]
    assert len(mesh.indices) == 40
    # 24 of them straight, 4 mm; 16 across.
    assert np.median(mesh.lengths_m) == pytest.approx(0.004, abs=1e-6)


def test_edges_are_symmetric() -> None:
    mesh = build_mesh(body_of(sphere()), INFO)
    starts = np.repeat(np.arange(len(mesh.points_m)), np.diff(mesh.indptr))
    there = dict(zip(zip(starts, mesh.indices, strict=True), mesh.lengths_m, strict=True))
    assert all(there[b, a] == length for (a, b), length in there.items())
    apart = np.linalg.norm(mesh.points_m[starts] - mesh.points_m[mesh.indices], axis=1)
    assert mesh.lengths_m == pytest.approx(apart)


@pytest.mark.parametrize("normal", [(0.0, 0.0, -1.0), (0.6, 0.0, -0.8), (0.3, -0.5, -0.812404)])
@pytest.mark.usefixtures("published")
def test_normals_of_a_tilted_plane(normal: tuple[float, float, float]) -> None:
    mesh = build_mesh(body_of(plane(normal), 280, 200), INFO)
    assert mesh.normals[inner(mesh)] == pytest.approx(
        np.broadcast_to(normal, (inner(mesh).sum(), 3)), abs=2e-3
    )


@pytest.mark.usefixtures("published")
def test_normals_of_a_sphere() -> None:
    # Normals point away from the centre. At 1 m pixels are 2 mm apart, so a chord between two is
    # 1/100 of the radius. The rim is excluded, because the 15 mm rule cuts it.
    mesh = build_mesh(body_of(sphere(), 280, 200), INFO)
    outwards = (mesh.points_m - (0, 0, 1)) / 0.2
    faces = inner(mesh) & (outwards[:, 2] < -0.5)
    assert faces.sum() > 1000
    assert mesh.normals[faces] == pytest.approx(outwards[faces], abs=0.02)


@pytest.mark.usefixtures("published")
def test_normals_are_weighted_by_angle() -> None:
    # A roof's ridge along v: on either side half of the angles, so it looks straight up, however
    # long the sides' edges are. The left side falls by 4 mm a pixel of 4 mm, 45 degrees, the right
    # one by 8 mm, 63.4 degrees; the mean of the two unit normals (-0.707, -0.707) and
    # (0.894, -0.447) is (0.0936, -0.5772), unit length (0.160, -0.987).
    depth = np.array([[2.004, 2.0, 2.008]] * 3)
    mesh = build_mesh(body_of(depth, 319, 239), INFO)
    assert mesh.normals[4] == pytest.approx((0.160, 0.0, -0.987), abs=0.02)


def test_normals_have_unit_length_and_face_the_sensor() -> None:
    random = np.random.default_rng(1)
    depth = plane((0.5, 0.2, -0.8)) + random.normal(0, 0.01, U.shape)
    mesh = build_mesh(body_of(depth, 280, 200), INFO)
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1.0)
    assert np.einsum("ij,ij->i", mesh.normals, mesh.points_m).max() < 0


def test_normal_of_a_single_vertex_points_to_the_sensor() -> None:
    mesh = build_mesh(body_of([[2.0]], 320, 240), INFO)
    assert mesh.normals.tolist() == [[0, 0, -1]]
    assert mesh.nearest((1.0, 1.0, 1.0)) == 0


def test_depth_is_averaged_on_its_own_surface_only() -> None:
    # Noise of 10 mm over 13 x 13 pixels: 10 mm / 13; neither wall moves towards the other.
    random = np.random.default_rng(2)
    depth = np.where(U < 320, 2.0, 2.3) + random.normal(0, 0.01, U.shape)
    mesh = build_mesh(body_of(depth, 280, 200), INFO)
    middle = (np.abs(mesh.pixels_px - (320, 240)) < 33).all(axis=1)
    off = mesh.points_m[:, 2] - np.where(mesh.pixels_px[:, 0] < 319.6, 2.0, 2.3)
    assert off[middle].std() < 0.002


def test_number_of_vertices_is_independent_of_the_size() -> None:
    for side in (40, 100, 300, 450):
        mesh = build_mesh(body_of(np.full((side, side), 2.0)), INFO)
        assert min(side * side, 1500) < len(mesh.points_m) + 1
        assert len(mesh.points_m) < 4600


@pytest.mark.parametrize("vertices", [10**9, 300])
def test_pixels_map_to_their_vertices(vertices: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_module, "VERTICES", vertices)
    mesh = build_mesh(body_of(sphere(), 280, 200), INFO)
    count = len(mesh.points_m)
    assert mesh.vertices_at(mesh.pixels_px).tolist() == list(range(count))
    positions = [mesh.nearest(point) for point in mesh.points_m[::37]]
    assert positions == list(range(count))[::37]


def test_pixels_off_the_body_have_no_vertex() -> None:
    mesh = build_mesh(body_of([[0.0, 2.0]], 100, 50), INFO)
    pixels = [(101, 50), (100, 50), (102, 50), (101, 49), (np.nan, 50), (np.inf, 1e300), (-1, -1)]
    assert mesh.vertices_at(pixels).tolist() == [0, -1, -1, -1, -1, -1, -1]
    assert mesh.vertices_at(np.empty((0, 2))).tolist() == []


@pytest.mark.usefixtures("published")
def test_pieces_are_bridged_where_they_are_nearest(monkeypatch: pytest.MonkeyPatch) -> None:
    # Two rows of pixels, the second 0.3 m behind; in the last column only 0.2 m.
    depth = np.array([[2.0] * 6, [2.3] * 5 + [2.2]])
    body = body_of(depth, 317, 240)
    monkeypatch.setattr(mesh_module, "EDGE_M", 0.11)
    apart = build_mesh(body, INFO)
    monkeypatch.setattr(mesh_module, "JOIN_M", 0.4)
    joined = build_mesh(body, INFO)
    assert len(joined.indices) == len(apart.indices) + 2
    links = joined.lengths_m[joined.lengths_m > 0.15]
    across = np.linalg.norm(joined.points_m[5] - joined.points_m[11])
    assert links == pytest.approx([across, across])


def test_empty_body_has_no_vertices() -> None:
    mesh = build_mesh(body_of(np.zeros((4, 4))), INFO)
    assert mesh.points_m.shape == (0, 3)
    assert mesh.nearest((0.0, 0.0, 1.0)) == -1
    assert mesh.vertices_at([(1, 1)]).tolist() == [-1]
