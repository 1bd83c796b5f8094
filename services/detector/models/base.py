"""Interface of people models: an image in, people with box, score and keypoints or mask out."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from people4d.messages import F32, U8
from services.detector.config import ModelSettings


@dataclass(frozen=True)
class InstanceMask:
    """Pixels of one person inside a window of the image."""

    window: U8  # HxW, 1 = person
    x_px: int  # [px] column of the window's first pixel
    y_px: int  # [px] row of the window's first pixel

    def cut(self, box: tuple[int, int, int, int]) -> U8:
        """Return the pixels inside a box (left, top, right, bottom)."""
        left, top, right, bottom = box
        height, width = self.window.shape
        cut = np.zeros((bottom - top, right - left), np.uint8)
        first_u, last_u = max(left, self.x_px), min(right, self.x_px + width)
        first_v, last_v = max(top, self.y_px), min(bottom, self.y_px + height)
        if first_u < last_u and first_v < last_v:
            own = self.window[first_v - self.y_px : last_v - self.y_px]
            own = own[:, first_u - self.x_px : last_u - self.x_px]
            cut[first_v - top : last_v - top, first_u - left : last_u - left] = own
        return cut


@dataclass(frozen=True)
class DetectedPerson:
    """One person in an image, in pixels of that image."""

    score: float  # 0 to 1
    box_xyxy_px: F32  # [px] 4: left, top, right, bottom edge; may reach beyond the image
    keypoints: F32 | None = None  # [px] 17x3: u, v, confidence 0 to 1, COCO order; absent if none
    mask: InstanceMask | None = None  # pixels of the person; absent if the model has no masks


class PersonModel(Protocol):
    """Finds people in a colour image; thread-safe."""

    name: str  # name of the model in results

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        """Find people in an HxWx3 colour image, best score first."""
        ...


@dataclass(frozen=True)
class Limits:
    """Thresholds of scores and overlaps."""

    score_min: float  # minimum score of the network
    iou_max: float  # maximum overlap of the boxes of two people
    max_people: int

    @classmethod
    def from_settings(cls, settings: ModelSettings, score_min: float, iou_max: float) -> "Limits":
        """Return the settings, completed by the given defaults."""
        minimum = score_min if settings.score_min is None else settings.score_min
        return cls(
            score_min=minimum * settings.score_scale,
            iou_max=iou_max if settings.iou_max is None else settings.iou_max,
            max_people=settings.max_people,
        )
