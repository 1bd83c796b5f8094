"""Colour: light and shadows of lamps."""

import math

import numpy as np
import pytest

from common.geometry.transforms import LINK_FROM_OPTICAL, invert, rotation_from_rpy, transform_from
from lab.drawing.ambient import bounce_light, direct_light
from lab.drawing.mesh import Material, Mesh, join
from lab.drawing.renderer import Instant, Renderer
from lab.drawing.rooms import Room, room_mesh
from lab.drawing.solids import Finish, box, panel
from people4d.messages import F64
from tests import builders

pytestmark = pytest.mark.render

INFO = builders.camera_info(width=80, height=60, fx=77.0, cx=39.5, cy=29.5)
PLASTER = Finish(Material.FABRIC, (0.5, 0.5, 0.5))


def pose(x_m: float = 0.0, pitch_deg: float = 3.0) -> F64:
    rotation = rotation_from_rpy(0.0, math.radians(pitch_deg), 0.0)
    return invert(transform_from([x_m, 0.0, 1.15], rotation) @ LINK_FROM_OPTICAL)


def block(x_m: float, y_m: float, height_m: float = 1.7) -> Mesh:
    """Return a body of box shape."""
    return join(box((x_m - 0.15, y_m - 0.2, 0.0), (x_m + 0.15, y_m + 0.2, height_m), PLASTER))


@pytest.fixture(scope="module")
def room() -> Room:
    return room_mesh("lab", 0)


@pytest.fixture(scope="module")
def renderer(room: Room) -> Renderer:
    return Renderer(room, INFO, seed=3)


def test_image_is_neither_black_nor_white(renderer: Renderer) -> None:
    image = renderer.exposed([Instant([block(3.5, 0.0)], pose())], 0)
    assert image.shape == (60, 80, 3)
    assert image.dtype == np.uint8
    assert 60 < image.mean() < 190
    assert image.std() > 20


def test_any_order_of_frames_and_any_threads_give_the_same_bytes(room: Room) -> None:
    people = [block(3.0, 0.5), block(4.0, -0.5)]
    first = Renderer(room, INFO, seed=3, threads=1)
    second = Renderer(room, INFO, seed=3, threads=2)
    forward = [first.exposed([Instant(people, pose(0.1 * k))], k).tobytes() for k in (0, 1, 2)]
    backward = [second.exposed([Instant(people, pose(0.1 * k))], k).tobytes() for k in (2, 1, 0)]
    assert forward == backward[::-1]


def test_noise_differs_from_frame_to_frame_and_by_seed(room: Room, renderer: Renderer) -> None:
    base = renderer.exposed([Instant([], pose())], 5).astype(int)
    later = renderer.exposed([Instant([], pose())], 6).astype(int)
    other = Renderer(room, INFO, seed=4).exposed([Instant([], pose())], 5).astype(int)
    for image in (later, other):
        assert 0.3 < np.abs(image - base).mean() < 6
        assert abs(np.mean(image - base)) < 0.3


def test_two_samples_smooth_edges_and_keep_surfaces(room: Room) -> None:
    instant = Instant([block(3.0, 0.0)], pose())
    ragged = Renderer(room, INFO, seed=0, samples=1).radiance(instant)
    smooth = Renderer(room, INFO, seed=0, samples=2).radiance(instant)
    assert np.median(np.abs(smooth - ragged)) < 0.03
    assert not np.array_equal(smooth, ragged)


def test_a_body_darkens_the_floor_beside_it(renderer: Renderer) -> None:
    # A lamp at (4.1, 0): a block at 3.4 m throws its shadow towards the camera, on the floor.
    empty = renderer.radiance(Instant([], pose(pitch_deg=20)))
    shaded = renderer.radiance(Instant([block(3.4, 0.0)], pose(pitch_deg=20)))
    on_floor = project_floor(3.0, 0.0)
    before, after = empty[on_floor].mean(), shaded[on_floor].mean()
    assert after < 0.85 * before
    far = project_floor(3.0, 1.2)
    assert shaded[far].mean() == pytest.approx(empty[far].mean(), rel=0.1)


def project_floor(x_m: float, y_m: float) -> tuple[int, int]:
    """Return row and column of a point of the floor."""
    x, y, z, _ = (float(value) for value in pose(pitch_deg=20) @ [x_m, y_m, 0.0, 1.0])
    return round(INFO.fy * y / z + INFO.cy), round(INFO.fx * x / z + INFO.cx)


def test_a_side_that_faces_a_lamp_is_brighter(renderer: Renderer) -> None:
    # The ceiling lamps light the top of a table at 0.6 m, and hardly its side towards the camera.
    image = renderer.radiance(Instant([block(3.2, 0.0, 0.6)], pose(pitch_deg=20)))
    top = row_of(3.2, 0.0, 0.6)
    side = row_of(3.05, 0.0, 0.3)
    assert image[top, 40].mean() > 1.2 * image[side, 40].mean()


def row_of(x_m: float, y_m: float, z_m: float) -> int:
    _, y, z, _ = (float(value) for value in pose(pitch_deg=20) @ [x_m, y_m, z_m, 1.0])
    return round(INFO.fy * y / z + INFO.cy)


def test_direct_light_follows_the_inverse_square(room: Room) -> None:
    light = room.lights[0]
    up = np.array([0.0, 0.0, 1.0])
    alone = Room(room.mesh, (light,), room.low_m, room.high_m, room.walls, room.exposure)
    near, far = (direct_light(alone, light.position_m - (0, 0, d), up) for d in (1.0, 2.0))
    # Intensity over distance^2 + radius^2, straight below: cosines are 1.
    np.testing.assert_allclose(near, light.intensity / (1 + light.radius_m**2))
    np.testing.assert_allclose(far, light.intensity / (4 + light.radius_m**2))


def test_walls_send_back_less_light_than_they_get(room: Room) -> None:
    bounce = bounce_light(room)
    middle = bounce[:, :, 0]  # the constant term: in the middle of the room
    assert (middle > 0).all()
    assert middle.mean() < direct_light(room, np.array([1.3, 0, 0.0]), np.array([0, 0, 1.0])).mean()
    dark = Room(room.mesh, room.lights, room.low_m, room.high_m, room.walls * 0.5, room.exposure)
    assert (bounce_light(dark)[:, :, 0] < 0.6 * middle).all()


def test_visible_lamp_is_the_brightest(renderer: Renderer) -> None:
    glow = panel((3.0, 0.3, 1.0), (0, -0.6, 0), (0, 0, 0.4), Finish(Material.LAMP, (4.0, 4.0, 4.0)))
    image = renderer.radiance(Instant([glow], pose()))
    assert image.max() == pytest.approx(4.0, rel=1e-5)
