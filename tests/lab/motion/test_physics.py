"""The simulated world obeys what measurements of the real one obey."""

import math
from itertools import combinations, pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial import cKDTree

from common.geometry.transforms import apply, deproject, wrap
from lab.camera.wheels import wheel_odometry
from lab.drawing.mesh import Material, Mesh
from lab.drawing.renderer import draw_depth
from lab.truth.motion_capture import capture_truth
from lab.world import World
from people4d.messages import F64
from tests.lab.worlds import world

pytestmark = pytest.mark.render

G_MPS2 = 9.81


def triangle_distance_m(points: F64, mesh: Mesh) -> F64:
    """Return how far points are from the plane of the nearest of the triangles about them."""
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


def test_feet_stay_where_they_stand() -> None:
    # Vertices of the shoes that are on the floor at two samples 10 ms apart do not slide; the
    # person walks at 1 m/s, a swinging foot moves at 3 m/s.
    of = world("short_walk")
    (first,) = of.meshes(0.8)
    shoes = np.unique(first.faces[first.material == Material.SHOE])
    soles = [of.meshes(t)[0].vertices_m[shoes] for t in np.arange(0.8, 2.4, 0.01)]
    speeds = []
    for before, after in pairwise(soles):
        assert 0 <= before[:, 2].min() < 0.002
        on_floor = (np.abs(before[:, 2]) < 0.004) & (np.abs(after[:, 2]) < 0.004)
        speeds.append(np.linalg.norm((after - before)[on_floor, :2], axis=1) / 0.01)
    speed = np.concatenate(speeds)
    assert len(speed) > 1000
    assert np.median(speed) < 0.01
    assert np.quantile(speed, 0.9) < 0.1


@pytest.mark.parametrize("name", ["four_crossing", "two_easy"])
def test_paths_stay_within_human_limits(name: str) -> None:
    # A minute at 100 Hz. Walking people turn by up to about 150 degrees a second on the spot and
    # start and stop with 1 to 2 m/s2; 0.3 g is what people take in without a step to the side.
    times = np.arange(0, 60, 0.01)
    for motion in world(name).motions:
        x, y, yaw = motion.path(times).T
        velocity = np.gradient(np.column_stack([x, y]), 0.01, axis=0)
        acceleration = np.gradient(velocity, 0.01, axis=0)
        speed = np.linalg.norm(velocity, axis=1)
        assert speed.max() < 1.45
        assert np.linalg.norm(acceleration, axis=1).max() < 0.3 * G_MPS2
        assert np.degrees(np.abs(np.gradient(yaw, 0.01))).max() < 150
        walking = speed > 0.3  # people walk the way they face
        heading = np.arctan2(velocity[:, 1], velocity[:, 0])
        assert np.degrees(np.abs(np.angle(np.exp(1j * (heading - yaw)))))[walking].max() < 10


def test_torsos_stay_within_human_limits() -> None:
    scenario = world("three_crossing").scenario
    plan = replace(scenario.capture, rate_hz=25.0)
    of = World(replace(scenario, capture=plan, duration_s=20.0))
    messages = list(capture_truth(of))
    for k in range(3):
        positions = np.array([message.people[k].position_m for message in messages])
        velocity = np.diff(positions, axis=0) * 25
        acceleration = np.linalg.norm(np.diff(velocity, axis=0), axis=1) * 25
        assert np.linalg.norm(velocity, axis=1).max() < 1.8
        assert acceleration.max() < 0.8 * G_MPS2  # each step brakes and lifts the trunk
        yaws = np.array([message.people[k].yaw_rad for message in messages])
        rates = np.degrees([abs(wrap(after - before)) * 25 for before, after in pairwise(yaws)])
        assert rates.max() < 200
        heights = positions[:, 2] / of.bodies[k].skeleton.stature_m
        assert np.ptp(heights) < 0.05  # 9 cm for the tallest: steps of 4 cm, knees at turns


def test_people_do_not_walk_through_each_other() -> None:
    # At the time at which two come nearest, their bodies do not touch: surfaces that cut each other
    # have vertices nearer than the spacing of about 1 cm.
    of = world("four_dense")
    times = np.arange(0, 60, 0.05)
    routes = [motion.path(times)[:, :2] for motion in of.motions]
    for one, other in combinations(range(4), 2):
        apart = np.linalg.norm(routes[one] - routes[other], axis=1)
        t_s = float(times[np.argmin(apart)])
        first, second = (of.meshes(t_s)[k].vertices_m for k in (one, other))
        nearest_m = np.asarray(cKDTree(first).query(second)[0])
        assert nearest_m.min() > 0.01, (one, other, t_s)


def test_odometry_is_the_pose_within_its_error_model() -> None:
    # Mahalanobis distance of what the wheels tell from where the base is: chi-squared with 3
    # degrees of freedom, 99.99 % of which are below 21.1.
    for name in ("short_robot", "pmrr", "psrm"):
        of = world(name)
        start = np.linalg.inv(of.path.map_from_base(0.0))
        for message in wheel_odometry(of.path, of.scenario.duration_s, of.seed)[::50]:
            truth = start @ of.path.map_from_base(message.stamp_ns / 1e9)
            yaw = math.atan2(truth[1, 0], truth[0, 0])
            error = np.array(
                [
                    message.x_m - truth[0, 3],
                    message.y_m - truth[1, 3],
                    wrap(message.theta_rad - yaw),
                ]
            )
            assert message.covariance is not None
            assert error @ np.linalg.solve(message.covariance, error) < 21.1
        assert np.linalg.norm(error[:2]) < 0.3
        assert abs(error[2]) < math.radians(20)
