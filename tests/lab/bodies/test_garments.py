"""Clothes and hair: shapes, ends and cuts of cloth."""

import msgspec
import numpy as np
import pytest
from numpy.testing import assert_allclose

from lab.bodies.body import dress
from lab.bodies.cast import CastMember, cast_names, linear, load_cast
from lab.bodies.figure import Figure, load_figure
from lab.bodies.garments import (
    SECTORS,
    arm_share,
    hanging_outline,
    make_legwear,
    make_shirt,
    make_shoes,
    measure,
)
from lab.bodies.surface import BodySurface, border, cut, smoothed
from lab.drawing.mesh import Material

EVERYBODY = pytest.mark.parametrize("name", cast_names())


def sheet(vertices: list[list[float]], faces: list[list[int]]) -> BodySurface:
    count = len(vertices)
    return BodySurface(
        vertices_m=np.array(vertices, np.float64),
        weights=np.eye(count),
        colour=np.zeros((count, 3)),
        faces=np.array(faces, np.int32),
        material=Material.SHIRT,
    )


def area(surface: BodySurface) -> float:
    a, b, c = (surface.vertices_m[surface.faces[:, i]] for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def worn(name: str) -> tuple[Figure, CastMember]:
    person = load_cast()[name]
    return load_figure(person.figure), person


def test_cutting_the_tip_off_a_triangle() -> None:
    # Right triangle with legs of 1: area 1/2. Above z = 3/4 a tip of 1/16 of it stays, 1/32.
    triangle = sheet([[0, 0, 0], [1, 0, 0], [0, 0, 1]], [[0, 1, 2]])
    height = triangle.vertices_m[:, 2]
    tip, rest = cut(triangle, height - 0.75), cut(triangle, 0.75 - height)
    assert area(tip) == pytest.approx(1 / 32)
    assert area(rest) == pytest.approx(1 / 2 - 1 / 32)
    # The rim is straight, with weights between the weights of the cut corners.
    assert tip.vertices_m[:, 2].min() == pytest.approx(0.75)
    on_rim = np.isclose(tip.vertices_m[:, 2], 0.75)
    assert_allclose(tip.weights[on_rim][:, 2], 0.75)
    assert_allclose(tip.weights.sum(axis=1), 1)


def test_cutting_keeps_the_side_that_is_outside() -> None:
    triangle = sheet([[0, 0, 0], [1, 0, 0], [0, 0, 1]], [[0, 1, 2]])
    for field in (triangle.vertices_m[:, 2] - 0.4, 0.4 - triangle.vertices_m[:, 2]):
        piece = cut(triangle, field)
        a, b, c = (piece.vertices_m[piece.faces[:, i]] for i in range(3))
        assert np.all(np.cross(b - a, c - a)[:, 1] < 0)  # as the triangle's own


def test_cutting_leaves_no_unused_vertex() -> None:
    square = sheet([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], [[0, 1, 2], [0, 2, 3]])
    piece = cut(square, square.vertices_m[:, 0] - 0.5)
    assert_allclose(area(piece), 0.5)
    assert set(np.unique(piece.faces)) == set(range(len(piece.vertices_m)))


def test_smoothing_moves_inner_vertices_only() -> None:
    # A pyramid over a square: its tip sinks halfway to the mean of its neighbours, at height 0.
    corners = [[0.0, 0, 0], [1.0, 0, 0], [1.0, 1, 0], [0.0, 1, 0], [0.5, 0.5, 1]]
    tent = sheet(corners, [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    soft = smoothed(tent, 1)
    assert_allclose(soft.vertices_m[:4], tent.vertices_m[:4])
    assert_allclose(soft.vertices_m[4], [0.5, 0.5, 0.5])
    assert len(border(tent.faces)) == 4


def test_cloth_hangs_from_protruding_parts() -> None:
    # 0.20 m at the top; each row of 15 mm below may come back by 0.22 * 15 = 3.3 mm. The body is
    # 0.10 m below but for a seat of 0.25 m in row 3, from which the cloth falls again.
    around, row = np.meshgrid(np.arange(SECTORS), np.arange(6))
    radius = np.where(row == 0, 0.20, 0.10) + 0.15 * (row == 3)
    positions = (around.ravel().astype(np.float64), row.ravel().astype(np.float64))
    outline = hanging_outline(*positions, radius.ravel())
    expected = [0.20, 0.1967, 0.1934, 0.25, 0.2467, 0.2434]
    assert_allclose(outline[:6], np.tile(expected, (SECTORS, 1)).T)


def test_srgb_to_linear() -> None:
    # IEC 61966-2-1: 0x80 = 0.50196 -> ((0.50196 + 0.055) / 1.055) ** 2.4 = 0.21586.
    assert_allclose(linear("#ff0080"), [1.0, 0.0, 0.21586], atol=1e-5)


def test_colours_are_checked() -> None:
    data = msgspec.to_builtins(load_cast()["adam"])
    with pytest.raises(msgspec.ValidationError, match=r"matching regex .* at `\$.skin`"):
        msgspec.convert({**data, "skin": "red"}, CastMember)


def test_only_twins_have_the_same_clothes() -> None:
    cast = load_cast()

    def appearance(name: str) -> tuple[object, ...]:
        person = cast[name]
        return person.skin, person.hair, person.shirt, person.legs, person.shoes

    assert appearance("twin_a") == appearance("twin_b")
    assert cast["twin_a"].figure != cast["twin_b"].figure
    outfits = [(person.shirt, person.legs) for person in cast.values()]
    assert len(set(outfits)) == len(cast) - 1


@EVERYBODY
def test_every_vertex_has_bones(name: str) -> None:
    figure, person = worn(name)
    for surface in dress(figure, person, seed=0):
        assert_allclose(surface.weights.sum(axis=1), 1, atol=1e-9)
        assert np.all(surface.weights >= 0)
        assert np.all(np.isfinite(surface.vertices_m))
        assert np.all((surface.colour >= 0) & (surface.colour <= 1))


@EVERYBODY
def test_hems_are_straight(name: str) -> None:
    figure, person = worn(name)
    levels = measure(figure, person)
    shirt = make_shirt(figure, person.shirt, levels)
    edge = shirt.vertices_m[np.unique(border(shirt.faces))]
    arms = arm_share(figure, shirt.weights)[np.unique(border(shirt.faces))] > 0.5
    hem = edge[~arms & (edge[:, 2] < levels.waist)]
    assert len(hem) > 20
    assert_allclose(hem[:, 2], levels.hem, atol=1e-9)


@EVERYBODY
def test_shirt_and_legwear_overlap(name: str) -> None:
    figure, person = worn(name)
    levels = measure(figure, person)
    shirt = make_shirt(figure, person.shirt, levels)
    legs = make_legwear(figure, person.legs, levels)
    torso = shirt.vertices_m[arm_share(figure, shirt.weights) < 0.5]
    assert legs.vertices_m[:, 2].max() > torso[:, 2].min() + 0.02


@EVERYBODY
def test_shoes_are_flat_below(name: str) -> None:
    figure, person = worn(name)
    uppers, soles = make_shoes(figure, person.shoes, measure(figure, person))
    assert soles.vertices_m[:, 2].min() < uppers.vertices_m[:, 2].min() - 0.01
    lowest = soles.vertices_m[:, 2] < soles.vertices_m[:, 2].min() + 1e-9
    assert np.mean(lowest) > 0.4


def test_bald_people_have_no_hair_and_beards_are_below_the_nose() -> None:
    figure, person = worn("george")
    pieces = dress(figure, person, seed=0)
    hair = [piece for piece in pieces if piece.material == Material.HAIR]
    crown = figure.vertices_m[:, 2].max()
    assert all(piece.vertices_m[:, 2].max() < crown - 0.04 for piece in hair)
    nose = figure.keypoint_forms[0, :, :3].sum(axis=0)
    assert any(piece.vertices_m[:, 2].max() < nose[2] + 0.07 for piece in hair)
