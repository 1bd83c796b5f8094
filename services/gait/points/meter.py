"""Measurement of a person's body in each frame: heights, heading, geodesic distances."""

from collections.abc import Callable

import numpy as np

from people4d.messages import F64
from services.gait.points.body import MeasuredBody, MeshObservation, heights_of, measure_body
from services.gait.points.heading import HeadingEstimator
from services.gait.surface.geodesic import geodesic_extrema, geodesic_m
from services.gait.surface.mesh import BodyMesh

VERTICES_MIN = 30  # Minimum number of vertices of a body
SHRINKAGE = 0.998  # Minimum stature, relative to the previous frame


class BodyMeter:
    """Measures one person's body; stature and heading persist between frames."""

    def __init__(self) -> None:
        self._heading = HeadingEstimator()
        self.heading: F64 | None = None  # 3, level, optical frame
        self.stature_m = 0.0

    def measure_body(
        self, observation: MeshObservation, source_vertex: Callable[[BodyMesh, F64], int]
    ) -> MeasuredBody | None:
        """Return the body of a frame; None if it is not visible.

        `source_vertex` maps mesh and heights to the source of geodesic distances.
        """
        mesh, pose = observation.mesh, observation.fixed_from_optical
        visible = mesh is not None and len(mesh.points_m) >= VERTICES_MIN
        heights_m = heights_of(mesh, observation.floor) if mesh and visible else np.empty(0)
        self.heading = self._heading.update_heading(
            mesh if visible else None, heights_m, observation.dt_s, pose, observation.yaw_rad
        )
        if mesh is None or not visible:
            return None
        top_m = float(np.quantile(heights_m, 0.995))
        self.stature_m = max(SHRINKAGE * self.stature_m, top_m)
        distances_m = geodesic_m(mesh, source_vertex(mesh, heights_m))
        extrema = geodesic_extrema(mesh, distances_m)
        return measure_body(mesh, heights_m, self.stature_m, distances_m, extrema)
