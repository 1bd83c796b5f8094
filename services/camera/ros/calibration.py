"""Calibration and transforms of ROS messages as ours."""

from typing import Any

import numpy as np

from common.geometry.transforms import invert
from people4d.errors import SourceError
from people4d.messages import F64
from services.camera.calibration import Intrinsics, to_intrinsics
from services.camera.ros.motion import FrameParents, edges_of

DISTORTIONS = {"plumb_bob": (4, 5), "rational_polynomial": (8,), "none": (0,), "": (0, 4, 5)}


def intrinsics_of(message: Any, rectified: bool = False) -> Intrinsics:
    """Read a sensor_msgs CameraInfo.

    Args:
        message: Of ROS 1 (fields K, D, P) or ROS 2 (k, d, p).
        rectified: The images are rectified: P holds and there is no distortion.

    Raises:
        SourceError: Its numbers cannot be used, or its distortion model is not supported.
    """
    k, d, p = (
        np.asarray(getattr(message, name, getattr(message, name.upper(), ())), np.float64)
        for name in ("k", "d", "p")
    )
    fx, fy, cx, cy = p[[0, 5, 2, 6]] if rectified and p.size == 12 and p[0] else k[[0, 4, 2, 5]]
    if not (np.all(np.isfinite([fx, fy, cx, cy, *d])) and fx > 0 and fy > 0):
        raise SourceError(
            f"CameraInfo: expected focal lengths > 0, got fx {fx}, fy {fy}, cx {cx}, cy {cy}",
            "Give the camera's calibration with options.calibration.",
        )
    coefficients = () if rectified or not np.any(d) else tuple(d.tolist())
    model = message.distortion_model.lower()
    if coefficients and len(coefficients) not in DISTORTIONS.get(model, ()):
        raise SourceError(
            f"CameraInfo: expected distortion plumb_bob or rational_polynomial, got "
            f"{len(coefficients)} numbers for {message.distortion_model!r:.40}"
        )
    return to_intrinsics(np.array([fx, fy, cx, cy]), coefficients, message.width, message.height)


class TransformTree:
    """A tree of static and moving transforms."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, F64]] = {}
        self._moving = FrameParents()

    def add(self, message: Any) -> None:
        """Add the valid static transforms of a tf2_msgs TFMessage."""
        for edge in edges_of(message):
            self._parents[edge.child] = (edge.parent, edge.matrix)

    def add_moving(self, message: Any) -> None:
        """Add the moving transforms of a tf2_msgs TFMessage, of which only the frames count."""
        for edge in edges_of(message):
            if edge.child not in self._parents:
                self._moving.add(edge.parent, edge.child)

    def find(self, target: str, source: str) -> F64 | None:
        """Return target_from_source, None without a static path between them."""
        of_source, of_target = (self._ancestors(name.strip("/")) for name in (source, target))
        for frame, ancestor_from_source in of_source.items():
            if frame in of_target:
                return invert(of_target[frame]) @ ancestor_from_source
        return None

    def climb(self, frame: str) -> list[tuple[str, str, F64 | None]]:
        """Return the path from a frame to the root of its tree.

        Returns:
            Parent, child and parent_from_child of each transform, nearest first; static ones in a
            row are one, and None is a moving one.
        """
        here, path, visited = frame.strip("/"), list[tuple[str, str, F64 | None]](), set[str]()
        while here not in visited:
            visited.add(here)
            top, top_from_here = list(self._ancestors(here).items())[-1]
            if top != here:
                path.append((top, here, top_from_here))
            (_, *parents) = self._moving.ancestors(top)[:2]
            if not parents:
                break
            path.append((parents[0], top, None))
            here = parents[0]
        return path

    def _ancestors(self, frame: str) -> dict[str, F64]:
        """Return ancestor_from_frame of the frame and its static ancestors, nearest first."""
        found = {frame: np.eye(4)}
        matrix = np.eye(4)
        while frame in self._parents:
            frame, parent_from_child = self._parents[frame]
            matrix = parent_from_child @ matrix
            if frame in found:  # a loop: not a tree
                break
            found[frame] = matrix
        return found
