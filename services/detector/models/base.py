"""Interface of people models: an image in, people with box, score and keypoints or mask out."""

from dataclasses import dataclass
from typing import Protocol

from people4d.messages import F32, U8
from services.detector.config import ModelSettings


@dataclass(frozen=True)
class InstanceMask:
    """Pixels of one person inside a window of the image."""

    window: U8  # HxW, 1 = person
    x_px: int  # [px] column of the window's first pixel
    y_px: int  # [px] row of the window's first pixel


@dataclass(frozen=True)
class DetectedPerson:
    """One person in an image, in pixels of that image."""

    score: float  # 0 to 1
    box_xyxy_px: F32  # [px] 4: left, top, right, bottom edge; may reach beyond the image
    keypoints: F32 | None = None  # [px] 17x3: u, v, confidence 0 to 1, COCO order; absent if none
    mask: InstanceMask | None = None  # absent if the model gives none


class PersonModel(Protocol):
    """Finds people in a colour image; may be called from several threads at once."""

    name: str  # of the model, for results

    def detect(self, rgb: U8) -> list[DetectedPerson]:
        """Find people.

        Args:
            rgb: HxWx3 colour image.

        Returns:
            The people, best score first.
        """
        ...


@dataclass(frozen=True)
class Limits:
    """Thresholds of a detection, and of two that are the same person."""

    score_min: float
    iou_max: float  # of two people's boxes
    max_people: int

    @classmethod
    def of(cls, settings: ModelSettings, score_min: float, iou_max: float) -> "Limits":
        """Return the settings, with the given values where they leave one open."""
        return cls(
            score_min=score_min if settings.score_min is None else settings.score_min,
            iou_max=iou_max if settings.iou_max is None else settings.iou_max,
            max_people=settings.max_people,
        )
