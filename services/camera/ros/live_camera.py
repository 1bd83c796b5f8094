"""Calibration and mount of a camera with live topics."""

from collections import Counter
from typing import Any

import numpy as np

from common.ros2.transforms import StampedTransform
from people4d.codec import encode
from people4d.errors import SourceError
from people4d.messages import F64
from services.camera.ros.camera import RosbagOptions, RosCamera, make_camera
from services.camera.ros.camera_info import same_numbers
from services.camera.ros.heads import ImageHead
from services.camera.ros.motion import FrameTree
from services.camera.ros.topics import Topics
from services.camera.source import SourceSetup

Size = tuple[int, int]  # height, width


class LiveCamera:
    """Calibration and mount from the newest messages, updated whenever one of them changes.

    Attributes:
        camera: Camera at the last frame; None if unknown.
        problem: Reason why the camera is unknown, one sentence; empty if it is known.
    """

    def __init__(self, topics: Topics, options: RosbagOptions, counters: Counter[str]) -> None:
        self.camera: RosCamera | None = None
        self.problem = ""
        self._topics = topics
        self._options = options
        self._counters = counters
        self._infos: dict[str, Any] = {}
        self._tree = FrameTree()
        self._static: dict[tuple[str, str], F64] = {}
        self._moving = set[tuple[str, str]]()
        self._base: tuple[str, str] | None = None
        self._version = 0  # number of changes of calibration and transforms
        self._of: Any = None  # images and version of `camera` and `problem`

    @property
    def knows_frames(self) -> bool:
        """True after the first transform."""
        return bool(self._static or self._moving)

    def add_info(self, topic: str, info: Any) -> None:
        """Store a CameraInfo."""
        known = self._infos.get(topic)
        if known is None or not same_numbers(known, info):
            self._infos[topic] = info
            self._version += 1

    def add_base(self, frame_id: str, child_frame_id: str) -> None:
        """Store the frames of odometry."""
        if self._base != (frame_id, child_frame_id):
            self._base = frame_id, child_frame_id
            self._version += 1

    def add_edge(self, edge: StampedTransform, static: bool) -> None:
        """Store a transform; a transform that closes a loop is dropped and counted."""
        names = edge.parent, edge.child
        known = self._static.get(names)
        if names in self._moving or (known is not None and np.array_equal(known, edge.matrix)):
            return
        if any(parent == edge.child for parent, *_ in self._tree.path(edge.parent)):
            self._counters["tf_loops"] += 1
            return
        if static:
            self._static[names] = edge.matrix
        else:
            self._moving.add(names)
        self._tree.add_transform(edge.parent, edge.child, edge.matrix if static else None)
        self._version += 1

    def setup(self, colour: tuple[Size, str], depth: tuple[Size, str], stamp_ns: int) -> Any:
        """Update `camera` by a pair of images.

        Returns:
            A SourceSetup if the camera became known or changed, else None.
        """
        if self._of == (colour, depth, self._version):
            return None
        self._of = colour, depth, self._version
        heads = (
            ImageHead(*colour, self._infos.get(self._topics.colour_info)),
            ImageHead(*depth, self._infos.get(self._topics.depth_info)),
        )
        try:
            camera = make_camera(self._topics, self._options, heads, self._tree, self._base)
        except SourceError as error:
            self.camera, self.problem = None, str(error)
            return None
        before, self.camera, self.problem = self.camera, camera, ""
        if before and _same(before, camera):
            return None
        self._counters["setups"] += 1
        self._counters["unlinked_frames"] += not camera.transforms and self.knows_frames
        moves = bool(camera.moving)
        return SourceSetup(camera.alignment.info, camera.transforms, moves, stamp_ns)


def _same(one: RosCamera, other: RosCamera) -> bool:
    first, second = ([encode(m) for m in (c.alignment.info, *c.transforms)] for c in (one, other))
    return one.moving == other.moving and first == second
