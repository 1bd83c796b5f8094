"""Choice of a frame's input size: a smaller one while all people in view are near the camera."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from common.geometry.boxes import iou_xyxy
from services.detector.config import NearInputConfig
from services.detector.models.base import DetectedPerson
from services.detector.models.letterbox import Letterbox

PERSON_MIN_PX = 100.0  # minimum height of a near person in the smaller input [px]
FULL_EVERY = 4  # frames between two at the full size, the second included


class _View(NamedTuple):
    """People in the last frame of a camera at the full size."""

    people: int
    are_near: bool
    frames: int = 0  # after it


class InputSizeChoice:
    """Chooses the input size of each camera's frames.

    The smaller one is enough while the last frame at the full size showed people, all of them near
    and apart from each other, and the later frames as many. Every n-th frame is at the full size,
    in which far and new people are found.
    """

    def __init__(self, config: NearInputConfig) -> None:
        self._config = config
        self._views: dict[str, _View] = {}

    def is_near(self, camera: str) -> bool:
        """Return whether the next frame of a camera gets the smaller input."""
        view = self._views.get(camera)
        return view is not None and view.are_near and view.frames < FULL_EVERY - 1

    def add_frame(
        self, camera: str, near: bool, people: Sequence[DetectedPerson], size: tuple[int, int]
    ) -> None:
        """Add the people of a frame.

        Args:
            camera: Its camera.
            near: True if it had the smaller input.
            people: People found in it.
            size: Height and width of the image [px].
        """
        if not near:
            self._views[camera] = _View(len(people), bool(people) and self._are_near(people, size))
        elif view := self._views.get(camera):
            same = view.are_near and len(people) == view.people
            self._views[camera] = view._replace(are_near=same, frames=view.frames + 1)

    def _are_near(self, people: Sequence[DetectedPerson], size: tuple[int, int]) -> bool:
        scale = Letterbox.fit(size, (self._config.height, self._config.width)).scale_y
        boxes = np.array([person.box_xyxy_px for person in people], np.float64)
        heights_px = scale * (boxes[:, 3] - boxes[:, 1])
        overlaps = iou_xyxy(boxes, boxes) - np.eye(len(boxes))
        return bool(heights_px.min() >= PERSON_MIN_PX and overlaps.max() <= 0.0)
