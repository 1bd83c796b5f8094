"""Furniture of a scenario: it hides legs, and people walk round it."""

import math
from pathlib import Path

import numpy as np
import pytest

from lab.catalogue import load_scenario
from lab.drawing.renderer import draw_depth
from lab.furniture import FurniturePlan, discs_of
from lab.truth.frames import person_views
from lab.world import World
from people4d.errors import ConfigError

DESK = """
about = "A person behind a desk."
duration_s = 6.0
seed = 5
room = "office"
[camera]
width = 160
height = 120
focal_px = 140.0
[[people]]
body = "adam"
start = [3.4, 0.0]
{path}
{furniture}
"""
BEFORE = '[[furniture]]\nkind = "{kind}"\nat = [2.6, 0.0]\n'


def world(folder: Path, furniture: str = "", path: str = "") -> World:
    file = folder / "desk.toml"
    file.write_text(DESK.format(furniture=furniture, path=path))
    return World(load_scenario(str(file)))


@pytest.mark.render
@pytest.mark.parametrize(("kind", "least"), [("partition", 0.5), ("cabinet", 0.3)])
def test_furniture_hides_legs(tmp_path: Path, kind: str, least: float) -> None:
    shares = []
    for furniture in ("", BEFORE.format(kind=kind)):
        of = world(tmp_path, furniture)
        meshes = [of.room.mesh, *of.meshes(1.0)]
        view = draw_depth(meshes, of.optical_from_map(1.0), of.info, 0.05)
        person = person_views(of, 1.0, view)[0]
        shares.append(person.visible_share)
        legs, shoulders = person.visible[13:17], person.visible[5:7]
        assert legs.all() == (not furniture)
        assert shoulders.all()
    assert shares[1] < (1 - least) * shares[0] + 0.1


def test_people_walk_round_furniture(tmp_path: Path) -> None:
    path = "path = [{ to = [1.0, 0.05] }]"
    times_s = np.arange(0, 6, 0.05)
    desk = BEFORE.format(kind="desk")
    walked = [
        np.array([motion.path(times_s)[:, :2] for motion in world(tmp_path, text, path).motions])[0]
        for text in ("", desk)
    ]
    piece = FurniturePlan(kind="desk", at=(2.6, 0.0))
    assert any(piece.holds(x, y) for x, y in walked[0])
    assert not any(piece.holds(x, y, 0.1) for x, y in walked[1])


def test_discs_cover_the_piece_and_little_more() -> None:
    piece = FurniturePlan(kind="desk", at=(1.0, 2.0), yaw_deg=30.0)
    discs = discs_of(piece)
    for x, y in np.random.default_rng(1).uniform(0, 3, (3000, 2)).tolist():
        covered = any(math.dist((x, y), disc[:2]) <= disc[2] + 0.15 for disc in discs)
        assert covered or not piece.holds(x, y)
        if any(math.dist((x, y), disc[:2]) <= disc[2] for disc in discs):
            assert piece.holds(x, y, 0.1)


def test_position_inside_furniture_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"people\[0\]: expected positions at least 0.2 m from"):
        world(tmp_path, '[[furniture]]\nkind = "desk"\nat = [3.4, 0.2]')
