"""YOLO segmentation: a box and a mask per person.

The logit of a mask is the sum of 32 prototype images weighted by 32 coefficients, at a quarter of
the input's size. Only the part in the box is computed, then scaled to the image's size.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from people4d.messages import F32, F64
from services.detector.models.base import DetectedPerson, InstanceMask
from services.detector.models.letterbox import Letterbox
from services.detector.models.network import Outputs, check_output
from services.detector.models.scores import ScoreCalibration
from services.detector.models.yolo import YoloBoxes, YoloCandidates

SEG_CALIBRATION = ScoreCalibration(midpoint=0.119, slope=3.1)
MASK_ROWS = 32
# Maximum shared part of the masks of two people, relative to the smaller mask. Two people share
# blurred edges, at most 0.55 in 640x480 frames of up to five people. Two boxes on one body share at
# least 0.91, even if their overlap is only 0.4
SHARED_MAX = 0.75


class YoloSeg(YoloBoxes):
    """Class "person" first, and a mask per box."""

    kind = "yolov8-seg"
    calibration = SEG_CALIBRATION
    extras = MASK_ROWS
    layout = "1x(4+classes+32)xN or 1xNx38, and 1x32xHxW"

    def _check(self, outputs: Outputs) -> None:
        super()._check(outputs)
        self._prototypes = next((name for name, array in outputs.items() if array.ndim == 4), "")
        if not self._prototypes:
            raise self._unknown(outputs)
        check_output(outputs, self._prototypes, (1, MASK_ROWS, None, None), self.name)

    def _people(self, outputs: Outputs, letterbox: Letterbox) -> list[DetectedPerson]:
        found = self._candidates(outputs)
        prototypes = outputs[self._prototypes][0].astype(np.float32, copy=False)
        view = MaskView(letterbox, *letterbox.image_size, prototypes)
        return drop_duplicates(
            [mask_person(found, index, view) for index in range(len(found.scores))]
        )


@dataclass(frozen=True)
class MaskView:
    """Mapping of mask coefficients to pixels of the image."""

    letterbox: Letterbox
    image_height: int  # [px]
    image_width: int  # [px]
    prototypes: F32  # 32xHxW over the network's whole input


def mask_person(found: YoloCandidates, index: int, view: MaskView) -> DetectedPerson:
    """Return a person with a mask in pixels of the image."""
    box = view.letterbox.to_image(found.boxes[index])
    return DetectedPerson(
        score=float(found.scores[index]),
        box_xyxy_px=box.astype(np.float32),
        mask=draw_mask(box, found.extras[index], view),
    )


def drop_duplicates(people: Sequence[DetectedPerson]) -> list[DetectedPerson]:
    """Drop people if a better mask contains their mask; people are sorted, best first."""
    selected: list[DetectedPerson] = []
    for person in people:
        if all(shared_part(person.mask, other.mask) <= SHARED_MAX for other in selected):
            selected.append(person)
    return selected


def shared_part(a: InstanceMask | None, b: InstanceMask | None) -> float:
    """Return the shared pixels of two masks, over the smaller mask's pixels, 0 to 1."""
    if a is None or b is None:
        return 0.0
    smaller = min(np.count_nonzero(a.window), np.count_nonzero(b.window))
    height, width = a.window.shape
    shared = a.window & b.cut((a.x_px, a.y_px, a.x_px + width, a.y_px + height))
    return np.count_nonzero(shared) / smaller if smaller else 0.0


def draw_mask(box: F64, coefficients: F32, view: MaskView) -> InstanceMask | None:
    """Return the pixels inside a box with a mask probability above one half.

    The interpolated logit is 0 exactly if its sigmoid is one half. None if the box (xyxy in pixels
    of the image) contains no pixel of the image.
    """
    sides = [view.image_width, view.image_height] * 2
    left, top, right, bottom = np.clip(np.round(box), 0, sides).astype(int)
    if right <= left or bottom <= top:
        return None
    factor, offset = grid_mapping(view)
    first, last = factor * (left, top) + offset, factor * (right, bottom) + offset
    logits, corner = logits_around(first, last, coefficients, view.prototypes)
    fine = cv2.warpAffine(
        logits,
        np.column_stack([np.diag(factor), first - corner]),
        (int(right - left), int(bottom - top)),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return InstanceMask((fine > 0).astype(np.uint8), int(left), int(top))


def logits_around(
    first: F64, last: F64, coefficients: F32, prototypes: F32
) -> tuple[F32, tuple[int, int]]:
    """Return the logits of the cells around a window, and the index (x, y) of the first one."""
    height, width = prototypes.shape[1:]
    end = (width - 1, height - 1)
    x0, y0 = np.clip(np.floor(first).astype(int), 0, end)
    x1, y1 = np.clip(np.ceil(last).astype(int), (x0, y0), end)
    part = prototypes[:, y0 : y1 + 1, x0 : x1 + 1]
    return np.tensordot(coefficients, part, axes=1), (int(x0), int(y0))


def grid_mapping(view: MaskView) -> tuple[F64, F64]:
    """Return factor and offset (x, y) from a pixel's index in the image to the prototypes' index.

    Indices are positions of pixel centres minus one half, in both.
    """
    letterbox = view.letterbox
    height, width = view.prototypes.shape[1:]
    cell = np.array([width / letterbox.input_width, height / letterbox.input_height])
    factor = cell * (letterbox.scale_x, letterbox.scale_y)
    return factor, 0.5 * factor + cell * (letterbox.left, letterbox.top) - 0.5
