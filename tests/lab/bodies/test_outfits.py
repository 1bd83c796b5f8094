import numpy as np
import pytest

from lab.bodies.body import load_body
from lab.bodies.cast import cast_names, linear, load_cast
from lab.bodies.outfits import dress_up
from lab.drawing.mesh import Material
from tests.lab.bodies.test_body import neutral


def test_own_outfit_is_that_of_the_cast() -> None:
    for person in load_cast().values():
        assert dress_up(person, "own", 3, 1) is person


def test_dark_outfits_are_dark_and_differ_a_little() -> None:
    dressed = [dress_up(load_cast()["erik"], "dark", 3, number) for number in range(20)]
    tops = np.array([linear(person.shirt.colour) for person in dressed])
    assert tops.max() < 0.06  # linear reflectance; the white shirt of erik has 0.58
    assert len({person.shirt.colour for person in dressed}) > 10
    spread = np.linalg.norm(tops - tops.mean(axis=0), axis=1).max()
    assert 0 < spread < 0.04


def test_random_outfits_vary_in_every_part() -> None:
    dressed = [
        dress_up(load_cast()[name], "random", seed, number)
        for number, name in enumerate(cast_names())
        for seed in range(10)
    ]
    assert len({person.shirt.colour for person in dressed}) > 100
    assert {person.shirt.pattern for person in dressed} >= {"plain", "stripes", "plaid", "print"}
    assert {person.hair.style for person in dressed} == {
        *("short", "long", "bob", "bun", "balding", "bald")
    }
    assert {person.legs.kind for person in dressed} == {"trousers", "shorts", "skirt"}
    dark = np.mean([linear(person.shirt.colour).max() < 0.06 for person in dressed])
    assert 0.1 < dark < 0.4


def test_same_seed_and_number_wear_the_same() -> None:
    person = load_cast()["joy"]
    assert dress_up(person, "random", 5, 2) == dress_up(person, "random", 5, 2)
    assert dress_up(person, "random", 5, 2) != dress_up(person, "random", 5, 3)
    assert dress_up(person, "random", 5, 2) != dress_up(person, "random", 6, 2)


@pytest.mark.parametrize("size", [0.9, 1.08])
def test_stature_scales_body_and_keypoints(size: float) -> None:
    usual, other = load_body("adam"), load_body("adam", size=size)
    assert other.skeleton.stature_m == pytest.approx(size * usual.skeleton.stature_m, rel=0.01)
    pose = neutral()
    head = [body.keypoints_m(pose)[0, 2] - body.keypoints_m(pose)[15, 2] for body in (usual, other)]
    assert head[1] == pytest.approx(size * head[0], rel=1e-6)


def test_every_figure_can_wear_every_outfit() -> None:
    for number, name in enumerate(cast_names()):
        mesh = load_body(name, 1, "random", number).mesh(neutral(), 1)
        assert np.isfinite(mesh.vertices_m).all()
        assert (mesh.material == Material.SHIRT).any()
