"""A detector with a given number of people, at the cost of a real one."""

from dataclasses import replace

import numpy as np

from people4d.messages import F32, U8
from services.detector.models.base import DetectedPerson
from services.detector.models.movenet import MoveNet

STEP_PX = 37.0  # distance of copies of a person [px]


class Crowd(MoveNet):
    """MoveNet with people copied side by side up to `max_people`.

    The network, its results, depth and crops are real; the copies are not.
    """

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        """Return `max_people` people of an HxWx3 image with at least one person."""
        found, width = super().detect(rgb), rgb.shape[1]
        count = self._limits.max_people if found else 0
        return [_moved(found[k % len(found)], k // len(found), width) for k in range(count)]


def _moved(person: DetectedPerson, copy: int, width: int) -> DetectedPerson:
    """Return a person a number of steps to the right, or to the left beyond the image's edge."""
    if not copy or person.keypoints is None:
        return person
    middle_px = float(person.box_xyxy_px[[0, 2]].mean())
    step_px = (middle_px + copy * STEP_PX) % width - middle_px
    box: F32 = person.box_xyxy_px + np.array([step_px, 0, step_px, 0], np.float32)
    keypoints: F32 = person.keypoints + np.array([step_px, 0, 0], np.float32)
    return replace(person, box_xyxy_px=box, keypoints=keypoints)
