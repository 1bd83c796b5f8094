"""Physical limits, known from measurements, hold in the simulated world."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from common.geometry.transforms import apply, deproject
from lab.drawing.mesh import Mesh
from lab.drawing.renderer import draw_depth
from people4d.messages import F64
from tests.lab.worlds import world

pytestmark = pytest.mark.render

G_MPS2 = 9.81


def triangle_distance_m(points: F64, mesh: Mesh) -> F64:
    """Return the distance of points from the plane of the nearest triangle around them."""
    corners = mesh.vertices_m[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    _, near = cKDTree(corners.mean(axis=1)).query(points, k=8)
    offset = points[:, None] - corners[near, 0]
    return np.asarray(np.abs(np.sum(offset * normals[near], axis=-1)).min(axis=1))


@pytest.mark.parametrize(("name", "t_s"), [("short_crossing", 1.3), ("short_robot", 2.6)])
def test_deprojected_pixels_of_a_mask_lie_on_the_body(name: str, t_s: float) -> None:
    # docs/method.md section 1: X = (u - cx) Z / fx, Y = (v - cy) Z / fy, and map_from_optical.
    of = world(name)
    meshes = of.meshes(t_s)
    view = draw_depth([of.room.mesh, *meshes], of.optical_from_map(t_s), of.info, 0.05)
    for k, mesh in enumerate(meshes):
        rows, columns = np.nonzero(view.owners == k + 1)
        assert len(rows) > 300
        pick = slice(None, None, 7)
        pixels = np.column_stack([columns, rows])[pick]
        optical = deproject(pixels, view.depth_m[rows, columns][pick], of.info)
        points = apply(of.map_from_optical(t_s), optical)
        to_vertex = np.asarray(cKDTree(mesh.vertices_m).query(points)[0])
        assert to_vertex.max() < 0.04  # triangles are no larger
        assert np.median(to_vertex) < 0.015
        assert np.quantile(triangle_distance_m(points, mesh), 0.99) < 0.001


def test_depth_of_the_wall_ahead_is_its_distance() -> None:
    # The lab's far wall is at x = 5.6; the camera is level at the origin, so Z = 5.6 on all of it.
    of = world("facing")
    view = draw_depth([of.room.mesh], of.optical_from_map(0.0), of.info, 0.05)
    # The ceiling, 2.6 - 1.15 = 1.45 m above the camera, meets the wall at row
    # 239.5 - 615 * 1.45 / 5.6 = 80.3; shelf, door and desk are lower than 2.2 m, row 124.2.
    upper = view.depth_m[82:110, 250:390]
    np.testing.assert_allclose(upper, 5.6, atol=0.001)
    ceiling = view.depth_m[78, 250:390]  # 1.45 * 615 / (239.5 - 78) = 5.522
    np.testing.assert_allclose(ceiling, 5.522, atol=0.001)


@pytest.mark.parametrize("name", ["four_crossing", "two_easy"])
def test_paths_stay_within_human_limits(name: str) -> None:
    # A minute at 100 Hz. Walking people turn by up to about 150 degrees a second and start and stop
    # with 1 to 2 m/s2; at 0.3 g people keep their balance without a step to the side.
    times = np.arange(0, 60, 0.01)
    for motion in world(name).motions:
        x, y, yaw = motion.path(times).T
        velocity = np.gradient(np.column_stack([x, y]), 0.01, axis=0)
        acceleration = np.gradient(velocity, 0.01, axis=0)
        speed = np.linalg.norm(velocity, axis=1)
        assert speed.max() < 1.45
        assert np.linalg.norm(acceleration, axis=1).max() < 0.3 * G_MPS2
        assert np.degrees(np.abs(np.gradient(yaw, 0.01))).max() < 150
        walking = speed > 0.3  # people walk in the direction of their yaw
        heading = np.arctan2(velocity[:, 1], velocity[:, 0])
        assert np.degrees(np.abs(np.angle(np.exp(1j * (heading - yaw)))))[walking].max() < 10
