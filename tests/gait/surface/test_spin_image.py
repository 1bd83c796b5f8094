"""Spin images of a plane and a sphere in closed form, and their similarity by hand."""

import math

import numpy as np
import pytest

from people4d.messages import F64
from services.gait.surface import spin_image
from services.gait.surface.mesh import BodyMesh, build_mesh
from services.gait.surface.spin_image import similarity, spin_images
from tests import builders
from tests.gait.builders import INFO, body_of

FINE = builders.camera_info(width=201, height=201, fx=1000.0, cx=100.0, cy=100.0)
V, U = np.mgrid[:201, :201].astype(np.float64)
pytestmark = pytest.mark.usefixtures("published")


@pytest.fixture
def every_vertex(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small bins, in which all vertices are counted."""
    monkeypatch.setattr(spin_image, "BIN_M", 0.004)
    monkeypatch.setattr(spin_image, "VERTICES_MAX", 10**9)


@pytest.fixture
def few_bins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Images of a few bins match."""
    monkeypatch.setattr(spin_image, "OVERLAP_MIN", 4)


def plane() -> BodyMesh:
    """A plane at 1 m: one point on each square millimetre, 0.1 m to each side."""
    return build_mesh(body_of(np.ones((201, 201))), FINE)


def sphere() -> BodyMesh:
    """The near side of a sphere of 60 mm about (0, 0, 1 m)."""
    rays = np.stack([(U - 100) / 1000, (V - 100) / 1000, np.ones_like(U)], axis=-1)
    a = np.einsum("ijk,ijk->ij", rays, rays)
    inside = 1 - a * (1 - 0.06**2)
    depth = np.where(inside > 0, (1 - np.sqrt(np.maximum(inside, 0))) / a, 0.0)
    return build_mesh(body_of(depth), FINE)


@pytest.mark.usefixtures("every_vertex")
def test_a_plane_in_closed_form() -> None:
    # All heights are 0: row 10 of 20, where the bins begin at -10. Alpha is shared by two bins in
    # proportion, so bin j has the density times the integral of 2 pi alpha (1 - |alpha/b - j|),
    # which is 2 pi j b^2; for j = 0 only its outer half, pi b^2 / 3. b = 4 mm, 1 point by mm^2.
    mesh = plane()
    (image,) = spin_images(mesh, mesh.vertices_at([(100, 100)]))
    expected = 2 * math.pi * np.arange(20) * 16
    expected[0] = math.pi * 16 / 3
    assert image[10] == pytest.approx(expected, rel=0.03, abs=4)
    image[10] = 0
    assert image == pytest.approx(0, abs=1e-2)  # depth is kept in single precision


@pytest.mark.usefixtures("every_vertex")
def test_a_sphere_in_closed_form() -> None:
    # A point of the sphere at the height beta (negative) over the plane that touches it is
    # alpha = sqrt(-beta (2 r + beta)) from the normal: only bins at this curve are filled.
    mesh = sphere()
    (image,) = spin_images(mesh, mesh.vertices_at([(100, 100)]))
    rows, columns = np.nonzero(image > 1)
    angle = np.linspace(0, math.pi / 2, 2000)
    curve = np.stack([10 - 15 * (1 - np.cos(angle)), 15 * np.sin(angle)])  # r = 60 mm: 15 bins
    distances = [
        np.hypot(curve[0] - r, curve[1] - c).min() for r, c in zip(rows, columns, strict=True)
    ]
    assert max(distances) < math.sqrt(2)
    filled = {(round(r), round(c)) for r, c in curve.T[:1200]}
    assert sum(image[cell] > 0 for cell in filled) > 0.95 * len(filled)


@pytest.mark.usefixtures("every_vertex")
def test_spin_images_of_a_sphere_are_similar_everywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    # The curve is the same at each vertex, as far as the camera sees the surface about it.
    mesh = sphere()
    monkeypatch.setattr(spin_image, "BIN_M", 0.002)
    ends = mesh.vertices_at([(100, 100), (115, 100), (100, 80), (112, 112)])
    images = spin_images(mesh, ends)
    flat = plane()
    (other,) = spin_images(flat, flat.vertices_at([(100, 100)]))
    similarities = similarity(np.concatenate([images, other[None]]), images[0])
    assert similarities[:4].min() > similarities[4] + 0.5


@pytest.mark.usefixtures("every_vertex")
def test_vertices_beyond_the_support_angle_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    # A roof, each side at 45 degrees to the sensor and 90 degrees to the other: an angle of less
    # than 90 degrees leaves one of them, a larger one both.
    k = np.abs(U - 100) / 1000
    mesh = build_mesh(body_of(1 / (1 - k)), FINE)
    vertex = mesh.vertices_at([(80, 100)])
    monkeypatch.setattr(spin_image, "SUPPORT_ANGLE_DEG", 60.0)
    narrow = spin_images(mesh, vertex)
    monkeypatch.setattr(spin_image, "SUPPORT_ANGLE_DEG", 100.0)
    wide = spin_images(mesh, vertex)
    assert np.flatnonzero(narrow[0].sum(axis=1) > 1).tolist() == [10]
    assert np.flatnonzero(wide[0].sum(axis=1) > 1).size > 3
    # 25 or more columns lie within 80 mm beyond the ridge, 20 mm to the right.
    assert wide.sum() > 1.3 * narrow.sum()


def test_bins_share_a_point_in_proportion(monkeypatch: pytest.MonkeyPatch) -> None:
    # One neighbour, 4 mm to the right and 1 mm nearer than the plane, bins of 10 mm: alpha 0.4,
    # beta 0.1 from the middle row 2 of 4. Itself: alpha 0, beta 0, all in (2, 0).
    mesh = plane()
    points = np.array([[0.0, 0.0, 1.0], [0.004, 0.0, 0.999]])
    two = BodyMesh(
        points_m=points,
        pixels_px=np.zeros((2, 2)),
        indptr=mesh.indptr[:1].repeat(3),
        indices=mesh.indices[:0],
        lengths_m=np.zeros(0),
        neighbours=np.full((2, 8), -1, np.int32),
        grid=mesh.grid[:0],
        left_px=0,
        top_px=0,
        step_px=1,
    )
    monkeypatch.setattr(spin_image, "BINS", 4)
    monkeypatch.setattr(spin_image, "BIN_M", 0.01)
    (image,) = spin_images(two, [0])
    expected = np.zeros((4, 4))
    expected[2, :2] = 0.9 * 0.6 + 1, 0.9 * 0.4
    expected[3, :2] = 0.1 * 0.6, 0.1 * 0.4
    assert image == pytest.approx(expected)


def test_sampled_spin_images_correlate_with_all_points(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = sphere()
    vertices = mesh.vertices_at([(100, 100), (110, 95)])
    monkeypatch.setattr(spin_image, "BIN_M", 0.005)
    some, same = spin_images(mesh, vertices), spin_images(mesh, vertices)
    assert np.array_equal(some, same)
    monkeypatch.setattr(spin_image, "VERTICES_MAX", 10**9)
    every = spin_images(mesh, vertices)
    for one, other in zip(every, some, strict=True):
        assert np.corrcoef(one.ravel(), other.ravel())[0, 1] > 0.95


@pytest.mark.usefixtures("every_vertex")
def test_invalid_vertex_has_an_empty_image() -> None:
    images = spin_images(plane(), [-1, 0, 10**9])
    assert images.sum(axis=(1, 2))[[0, 2]].tolist() == [0, 0]
    assert images[1].sum() > 0
    assert spin_images(plane(), []).shape == (0, 20, 20)
    nothing = build_mesh(body_of(np.zeros((3, 3))), INFO)
    assert not spin_images(nothing, [0]).any()


def row(*bins: float) -> F64:
    image = np.zeros((4, 4))
    image[0, : len(bins) - 1], image[1, 0] = bins[:-1], bins[-1]
    return image


@pytest.mark.usefixtures("few_bins")
def test_similarity_by_hand() -> None:
    # (1, 2, 3, 4, 5) and (1, 2, 3, 5, 4): deviations (-2, -1, 0, 1, 2) and (-2, -1, 0, 2, 1),
    # R = (4 + 1 + 0 + 2 + 2) / 10 = 0.9, atanh(0.9) = 1.47222, squared 2.16743. N = 5 and lambda
    # = 5 / 2: 2.5 / (5 - 3) = 1.25.
    found = similarity(row(1, 2, 3, 4, 5)[None], row(1, 2, 3, 5, 4))
    assert found == pytest.approx([2.16743 - 1.25], abs=1e-4)


@pytest.mark.usefixtures("few_bins")
def test_only_bins_filled_in_both_count() -> None:
    # The sixth bin is filled in the image only: R is unchanged, lambda now 6 / 2.
    image = row(1, 2, 3, 4, 5)
    image[3, 3] = 40
    found = similarity(image[None], row(1, 2, 3, 5, 4))
    assert found == pytest.approx([2.16743 - 1.5], abs=1e-4)


@pytest.mark.usefixtures("few_bins")
def test_negative_correlation_is_less_similar_than_none() -> None:
    images = np.stack([row(1, 2, 3, 4, 5), row(5, 4, 3, 2, 1), row(2, 2, 2, 2, 2)])
    same, reverse, level = similarity(images, row(1, 2, 3, 4, 5))
    assert reverse < level < same
    assert np.isfinite(same)


def test_too_few_common_bins_are_no_match(monkeypatch: pytest.MonkeyPatch) -> None:
    images = np.stack([row(1, 2, 3, 4, 5), row(1, 2, 3, 0, 0), np.zeros((4, 4))])
    reference = row(1, 2, 3, 5, 4)
    assert similarity(images, reference).tolist() == [-np.inf] * 3
    assert similarity(images[:0], reference).shape == (0,)
    monkeypatch.setattr(spin_image, "OVERLAP_MIN", 4)
    assert np.isfinite(similarity(images, reference)).tolist() == [True, False, False]
    assert similarity(images, np.zeros((4, 4))).tolist() == [-np.inf] * 3


def test_similarity_does_not_depend_on_the_number_of_points() -> None:
    # A nearer view has more vertices: all bins grow by the same factor.
    random = np.random.default_rng(3)
    images = 0.1 + random.random((5, 20, 20))
    more = similarity(7.0 * images, images[0])
    assert more == pytest.approx(similarity(images, images[0]))
