"""A sensor with an infrared projector: registration to colour, surfaces that reflect no light."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from lab.depth.config import SENSORS
from lab.depth.infrared import reflectance
from lab.depth.registration import register
from lab.depth.sensor import DepthSensor
from lab.drawing.mesh import Material, Mesh, join
from lab.drawing.renderer import SurfaceView, draw_surfaces
from lab.drawing.solids import Finish, panel, srgb
from people4d.messages import U16
from tests import builders

INFO = builders.camera_info(width=160, height=120, fx=100.0, cx=79.5, cy=59.5)
XTION = SENSORS["xtion"]
EXACT = structs.replace(
    XTION, noise_px=0.0, ragged_px=0.0, holes=0.0, edge_holes=0.0, shift_px=(0.0, 0.0)
)


def upright(material: Material, colour: tuple[int, int, int], z_m: float, x_m: float) -> Mesh:
    """Return a wall across the image at a depth, right of x, in the optical frame."""
    return panel((x_m, 9.0, z_m), (20.0, 0, 0), (0, -18.0, 0), Finish(material, srgb(*colour)))


def draw(*meshes: Mesh) -> SurfaceView:
    return draw_surfaces(meshes, np.eye(4), INFO, EXACT)


def read(view: SurfaceView) -> U16:
    sensor = DepthSensor(structs.replace(EXACT, left_band=False), INFO, 3)
    return sensor.measure(view.depth_m, view.right_depth_m, 1.0, view.light)


def test_registration_moves_a_reading_by_offset_over_depth() -> None:
    reading = np.zeros((1, 12), np.uint16)
    reading[0, 2], reading[0, 9] = 1000, 2500
    # 0.05 m x 100 px = 5 px m: 5 px at 1 m, 2 px at 2.5 m.
    assert register(reading, 0.05, INFO)[0].tolist() == [0] * 7 + [1000] + [0] * 3 + [2500]


def test_nearer_of_two_readings_at_one_pixel_stays() -> None:
    reading = np.zeros((1, 12), np.uint16)
    reading[0, 2], reading[0, 5] = 1000, 2500  # both map to column 7
    assert register(reading, 0.05, INFO)[0].tolist() == [0] * 7 + [1000] + [0] * 4


def test_registration_leaves_no_cracks_in_a_slope_and_a_gap_beside_a_near_surface() -> None:
    slope = np.linspace(3000, 1500, 140).astype(np.uint16)[None]
    registered = register(slope, 0.05, INFO)[0]
    valid = np.flatnonzero(registered)
    assert (np.diff(valid) == 1).all()
    step = np.full((1, 100), 4000, np.uint16)
    step[0, 40:60] = 1000
    # The depth imager stands left: near surfaces move left by 5 px, the wall by 1.25.
    moved = register(step, -0.05, INFO)[0]
    assert (moved[35:55] == 1000).all()
    assert (moved[55:59] == 0).all()  # seen by the colour camera alone


def test_depth_moves_in_steps_that_grow_with_the_square_of_the_depth() -> None:
    steps = []
    for z_m in (1.5, 3.0, 6.0):
        tilted = replace(wall := upright(Material.PAINT, (200, 200, 200), z_m, -10.0))
        vertices = wall.vertices_m.copy()
        vertices[:, 2] += 0.03 * vertices[:, 0]
        values = np.unique(read(draw(replace(tilted, vertices_m=vertices))))
        steps.append(np.median(np.diff(values[values > 0].astype(float))) / 1000)
    expected = [z**2 / 8 / (575 * 0.075) for z in (1.5, 3.0, 6.0)]
    np.testing.assert_allclose(steps, expected, rtol=0.15)


def test_shadow_lies_left_of_near_surfaces_if_the_step_is_large() -> None:
    wall = upright(Material.PAINT, (200, 200, 200), 3.0, -10.0)
    for near_m, has_shadow in ((0.8, True), (1.8, False)):
        near = panel(
            (0.0, 0.6, near_m), (0.4, 0, 0), (0, -1.2, 0), Finish(Material.PAINT, (0.5,) * 3)
        )
        config = structs.replace(EXACT, colour_offset_m=0.0, shadow_gap_px=4.0)
        view = draw_surfaces([wall, near], np.eye(4), INFO, config)
        row = DepthSensor(config, INFO, 3).measure(
            view.depth_m, view.right_depth_m, 1.0, view.light
        )[60]
        left = int(np.flatnonzero((row > 0) & (row < 1900))[0])
        right = int(np.flatnonzero((row > 0) & (row < 1900))[-1])
        # 100 px x 0.075 m (1 / 0.8 - 1 / 3) = 6.9 px of shadow; at 1.8 m the step is 1.7 px.
        assert (row[left - 6 : left] == 0).all() == has_shadow
        assert row[right + 2] > 0


@pytest.mark.parametrize(
    ("material", "colour", "z_m", "is_read"),
    [
        (Material.SHIRT, (20, 20, 24), 3.0, True),  # dyes are transparent to infrared light
        (Material.SHIRT, (20, 20, 24), 8.5, False),
        (Material.HAIR, (20, 16, 14), 1.5, True),
        (Material.HAIR, (20, 16, 14), 4.5, False),
        (Material.FABRIC, (24, 24, 27), 3.0, False),  # a screen
        (Material.LAMP, (255, 255, 255), 2.0, False),  # a window
        (Material.PAINT, (200, 200, 200), 6.0, True),
    ],
)
def test_dark_and_far_surfaces_return_too_little_light(
    material: Material, colour: tuple[int, int, int], z_m: float, is_read: bool
) -> None:
    share = float((read(draw(upright(material, colour, z_m, -10.0)))[:, 20:-20] > 0).mean())
    assert share > 0.9 if is_read else share < 0.1


def test_light_falls_with_the_cosine_and_the_square_of_the_distance() -> None:
    wall = upright(Material.PAINT, (200, 200, 200), 2.0, -10.0)
    view = draw(wall)
    share = float(reflectance(wall)[0])
    assert view.light[60, 80] == pytest.approx(share / 4, rel=0.01)
    # Beside the middle: 0.5 to the side at 1 ahead, cosine 0.894, distance 2.236 m.
    assert view.light[60, 130] == pytest.approx(share * 0.894 / 2.236**2, rel=0.02)


def test_scene_of_several_meshes_has_the_light_of_each() -> None:
    dark, pale = (
        upright(Material.SHOE, (20, 20, 20), 2.0, -20.0),
        upright(Material.PAINT, (220, 220, 220), 2.0, 0.0),
    )
    light = draw(join([dark, pale])).light
    assert light[60, 100] > 3 * light[60, 50] > 0
