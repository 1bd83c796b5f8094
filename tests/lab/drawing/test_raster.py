"""The rasteriser against geometry that is known in closed form."""

import numpy as np
import pytest

from common.geometry.transforms import camera_matrix, deproject, project
from lab.drawing.mesh import Mesh
from lab.drawing.raster import barycentrics, homogeneous, rasterise
from lab.drawing.renderer import body_extents, draw_depth
from people4d.messages import F64
from tests import builders

pytestmark = pytest.mark.render

INFO = builders.camera_info(width=80, height=60, fx=70.0, fy=75.0, cx=38.5, cy=31.0)
SIZE = (INFO.height, INFO.width)


def mesh(triangles_m: list[list[list[float]]], owner: int = 1) -> Mesh:
    """Return loose triangles; optical frame = map in these tests."""
    vertices = np.array(triangles_m, np.float64).reshape(-1, 3)
    count = len(triangles_m)
    return Mesh(
        vertices_m=vertices,
        normals=np.tile([0.0, 0.0, -1.0], (len(vertices), 1)),
        texture_m=vertices.astype(np.float32),
        colour=np.full((len(vertices), 3), 0.5, np.float32),
        faces=np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        material=np.zeros(count, np.int32),
        pattern=np.zeros(count, np.int32),
        owner=np.full(count, owner, np.int32),
    )


def quad(corners_m: list[list[float]], owner: int = 1) -> Mesh:
    a, b, c, d = corners_m
    return mesh([[a, b, c], [a, c, d]], owner)


def wall(z_m: float, half_m: float = 10.0, owner: int = 1) -> Mesh:
    h = half_m
    return quad([[-h, -h, z_m], [h, -h, z_m], [h, h, z_m], [-h, h, z_m]], owner)


def pixels() -> F64:
    rows, columns = np.mgrid[0 : INFO.height, 0 : INFO.width]
    return np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64)


def test_depth_of_a_tilted_plane_is_exact_at_every_pixel() -> None:
    # z = 3 + 0.4 x - 0.3 y; along the ray (rx, ry, 1) z: z (1 - 0.4 rx + 0.3 ry) = 3.
    corners = [[x, y, 3 + 0.4 * x - 0.3 * y] for x, y in [(-4, -4), (4, -4), (4, 4), (-4, 4)]]
    depth = draw_depth([quad(corners)], np.eye(4), INFO, 0.05).depth_m
    rays = deproject(pixels(), np.ones(len(pixels())), INFO)
    expected = 3 / (1 - 0.4 * rays[:, 0] + 0.3 * rays[:, 1])
    np.testing.assert_allclose(depth.ravel(), expected, atol=1e-5)


def test_deprojected_pixels_lie_on_the_triangle_and_inside_it() -> None:
    corners_m = np.array([[-0.9, -0.7, 2.0], [1.1, -0.5, 3.0], [0.1, 1.0, 2.5]])
    depth = draw_depth([mesh([corners_m.tolist()])], np.eye(4), INFO, 0.05).depth_m
    in_view = np.isfinite(depth.ravel())
    points = deproject(pixels()[in_view], depth.ravel()[in_view], INFO)
    normal = np.cross(corners_m[1] - corners_m[0], corners_m[2] - corners_m[0])
    np.testing.assert_allclose((points - corners_m[0]) @ normal, 0.0, atol=1e-5)
    # A pixel is seen exactly if its centre is inside the projected triangle.
    a, b, c = project(corners_m, INFO)
    sides = [
        (q[0] - p[0]) * (pixels()[:, 1] - p[1]) - (q[1] - p[1]) * (pixels()[:, 0] - p[0])
        for p, q in ((a, b), (b, c), (c, a))
    ]
    np.testing.assert_array_equal(in_view, np.all(np.array(sides) >= 0, axis=0))
    assert 500 < in_view.sum() < 3000


def test_both_sides_of_a_triangle_are_drawn() -> None:
    one = [[-0.9, -0.7, 2.0], [1.1, -0.5, 3.0], [0.1, 1.0, 2.5]]
    front = draw_depth([mesh([one])], np.eye(4), INFO, 0.05)
    back = draw_depth([mesh([one[::-1]])], np.eye(4), INFO, 0.05)
    np.testing.assert_array_equal(front.owners, back.owners)


def test_the_nearest_wins_in_any_order() -> None:
    near, far = wall(2.0, 0.3, owner=1), wall(3.0, owner=2)
    for scene in ([near, far], [far, near]):
        view = draw_depth(scene, np.eye(4), INFO, 0.05)
        assert view.depth_m[31, 38] == pytest.approx(2.0)
        assert view.owners[31, 38] == 1
        assert view.depth_m[0, 0] == pytest.approx(3.0)
        assert view.owners[0, 0] == 2


def test_triangle_that_reaches_behind_the_camera_is_drawn() -> None:
    # A floor 1 m below the eye, from 5 m behind to 100 m ahead: z = fy / (v - cy) below cy.
    floor = quad([[-90, 1, -5], [90, 1, -5], [90, 1, 100], [-90, 1, 100]])
    depth = draw_depth([floor], np.eye(4), INFO, 0.05).depth_m
    rows = np.arange(INFO.height)
    below = rows >= 32  # the first has z = 75 m
    expected = np.broadcast_to((INFO.fy / (rows[below] - INFO.cy))[:, None], depth[below].shape)
    np.testing.assert_allclose(depth[below], expected, rtol=1e-6)
    assert np.isinf(depth[~below]).all()


def test_triangles_behind_the_camera_or_too_near_are_not_drawn() -> None:
    view = draw_depth([wall(-2.0), wall(0.0), wall(0.04)], np.eye(4), INFO, 0.05)
    assert np.isinf(view.depth_m).all()
    assert np.isinf(view.right_depth_m).all()
    assert not view.owners.any()


def test_an_empty_scene_is_infinitely_far() -> None:
    view = draw_depth([], np.eye(4), INFO, 0.05)
    assert view.depth_m.shape == SIZE
    assert np.isinf(view.depth_m).all()
    assert not view.owners.any()


def test_no_pixel_falls_between_neighbours() -> None:
    # A wall of 30 x 30 uneven tiles, each of two triangles.
    rng = np.random.default_rng(3)
    steps = np.linspace(-2.5, 2.5, 31)
    points = np.dstack([*np.meshgrid(steps, steps), np.full((31, 31), 2.0)])
    points += rng.uniform(-0.06, 0.06, points.shape)
    tiles = [
        [points[i, j], points[i, j + 1], points[i + 1, j + 1], points[i + 1, j]]
        for i in range(30)
        for j in range(30)
    ]
    halves = [half for a, b, c, d in tiles for half in ([a, b, c], [a, c, d])]
    assert np.isfinite(draw_depth([mesh(halves)], np.eye(4), INFO, 0.05).depth_m).all()


def test_the_right_imager_sees_things_further_left() -> None:
    # f b / z = 70 x 0.1 / 2 = 3.5 px: an edge half way between pixels moves by 3.5.
    edge = (40.75 - INFO.cx) / INFO.fx * 2.0  # u = 40.75: the first column seen is 41, then 38
    half_wall = quad([[edge, -9, 2], [9, -9, 2], [9, 9, 2], [edge, 9, 2]])
    view = draw_depth([half_wall], np.eye(4), INFO, 0.1)
    assert np.flatnonzero(np.isfinite(view.depth_m[20]))[0] == 41
    assert np.flatnonzero(np.isfinite(view.right_depth_m[20]))[0] == 38  # 40.75 - 3.5 = 37.25


def test_threads_do_not_change_the_result() -> None:
    rng = np.random.default_rng(5)
    positions = rng.uniform([-1, -1, 0.02], [1, 1, 3], (300, 1, 3))
    clutter = mesh((positions + rng.normal(0, 0.2, (300, 3, 3))).tolist())
    one = draw_depth([clutter], np.eye(4), INFO, 0.05, threads=1)
    two = draw_depth([clutter], np.eye(4), INFO, 0.05, threads=2)
    assert one.depth_m.tobytes() == two.depth_m.tobytes()
    assert one.owners.tobytes() == two.owners.tobytes()
    assert one.right_depth_m.tobytes() == two.right_depth_m.tobytes()


def test_barycentrics_give_the_visible_point() -> None:
    triangle = mesh([[[-0.9, -0.7, 2.0], [1.1, -0.5, 3.0], [0.1, 1.0, 2.5]]])
    corners = homogeneous(triangle.vertices_m, camera_matrix(INFO) @ np.eye(4)[:3])
    depth = rasterise(corners, triangle.faces, SIZE).depth_m()
    b, c = barycentrics(corners, 0, 1, 2, 40.0, 30.0)
    point = np.array([1 - b - c, b, c]) @ triangle.vertices_m
    expected = deproject([[40, 30]], [depth[30, 40]], INFO)[0]
    np.testing.assert_allclose(point, expected, atol=1e-6)


def test_extents_ignore_occluders() -> None:
    # 0.4 m at 2 m: 14 px wide around cx = 38.5, 15 px high around cy = 31.
    extent = body_extents(wall(2.0, 0.2), np.eye(4), INFO)
    np.testing.assert_array_equal(extent.box_xyxy_px, [32, 24, 46, 39])
    assert extent.pixels == 14 * 15
    nowhere = body_extents(wall(-2.0), np.eye(4), INFO)
    assert nowhere.pixels == 0
    assert np.isnan(nowhere.box_xyxy_px).all()
