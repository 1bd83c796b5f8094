"""RTMO [Lu 2024] in the layout of MMDeploy's exports: boxes and keypoints of all people at once."""

from typing import ClassVar

import cv2
import numpy as np

from common.inference.session import Array
from people4d.messages import F32, U8
from services.detector.models.base import DetectedPerson
from services.detector.models.letterbox import Letterbox
from services.detector.models.network import Outputs, check_output
from services.detector.models.yolo import KEYPOINT_ROWS, PERSON, YoloPose

BOXES, KEYPOINTS = "dets", "keypoints"  # names of the outputs


class Rtmo(YoloPose):
    """Boxes (1xNx5: left, top, right, bottom, score) and keypoints (1xNx17x3)."""

    kind = "rtmo"
    default_size: ClassVar[tuple[int, int]] = (640, 640)
    highest = 255.0

    def input_of(self, rgb: U8) -> tuple[Letterbox, Array]:
        """Return the position of an image (HxWx3) in the network's input, and that input."""
        return super().input_of(np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), np.uint8))

    def _check(self, outputs: Outputs) -> None:
        check_output(outputs, BOXES, (1, None, 5), self.name)
        check_output(outputs, KEYPOINTS, (1, None, 17, 3), self.name)
        super()._check(_rows(outputs))

    def _people(self, outputs: Outputs, letterbox: Letterbox) -> list[DetectedPerson]:
        return super()._people(_rows(outputs), letterbox)


def _rows(outputs: Outputs) -> dict[str, F32]:
    """Return the outputs in the layout of YOLO with NMS inside."""
    boxes, keypoints = outputs[BOXES][0], outputs[KEYPOINTS][0]
    persons = np.full((len(boxes), 1), PERSON)
    flat = keypoints.reshape(-1, KEYPOINT_ROWS)
    return {"rows": np.hstack([boxes, persons, flat]).astype(np.float32)[None]}
